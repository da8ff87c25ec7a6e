#!/bin/sh
# What the Dockerfile does in its stages, for the machine that TARGETARCH and TARGETVARIANT name: amd64, arm64 or arm/v7.
#
#   build.sh tools             installs what compiles for that machine, as far as it is missing
#   build.sh program           compiles the program, exactly as Cargo.lock has it, and gathers the licences of its parts
#   build.sh root DEBIAN ROOT  fills ROOT with the program and what it needs of the Debian at DEBIAN
set -eu

# Rust's name of the machine, the compiler's, and Debian's.
names() {
    case "${TARGETARCH:-$(dpkg --print-architecture)}/${TARGETVARIANT:-}" in
        amd64/) rust=x86_64-unknown-linux-gnu gnu=x86_64-linux-gnu debian=amd64 ;;
        arm64/ | arm64/v8) rust=aarch64-unknown-linux-gnu gnu=aarch64-linux-gnu debian=arm64 ;;
        arm/ | arm/v7 | armhf/) rust=armv7-unknown-linux-gnueabihf gnu=arm-linux-gnueabihf debian=armhf ;;
        *)
            echo "build.sh: $TARGETARCH/${TARGETVARIANT:-} is not supported; amd64, arm64 and arm/v7 are" >&2
            exit 1
            ;;
    esac
    program=target/$rust/dist/vfd-gateway
}

# What a machine has for itself it has already.
tools() {
    if [ "$rust" != "$(rustc -vV | sed -n 's/^host: //p')" ]; then
        rustup target add "$rust"
    fi
    missing=
    command -v "$gnu-gcc" >/dev/null || missing="gcc-$(echo "$gnu" | tr _ -) libc6-dev-$debian-cross"
    command -v python3 >/dev/null || missing="$missing python3"
    if [ -n "$missing" ]; then
        apt-get update
        # shellcheck disable=SC2086
        apt-get install -y --no-install-recommends $missing
        rm -rf /var/lib/apt/lists/*
    fi
}

# Which C compiler belongs to a target is known for its C code, but not for linking.
program() {
    variable=CARGO_TARGET_$(echo "$rust" | tr a-z- A-Z_)_LINKER
    env "$variable=$gnu-gcc" cargo build --profile dist --locked --target "$rust" --bin vfd-gateway
    release/notices target/notices "$rust"
}

# The program and the libraries that it names, the loader where the program expects it, whom to trust where `mqtts://` has
# no `ca_file`, and the licences of it all.
root() {
    from=$1 to=$2
    install -D "$program" "$to/usr/local/bin/vfd-gateway"
    loader=$(readelf -l "$program" | sed -n 's/.*interpreter: \(.*\)]/\1/p')
    # Not from where the program expects it: that is a link, which may lead out of the Debian that is looked at.
    install -D "$from/lib/$gnu/${loader##*/}" "$to$loader"
    libraries_of "$program"
    install -D -m 644 /etc/ssl/certs/ca-certificates.crt "$to/etc/ssl/certs/ca-certificates.crt"
    install -d "$to/usr/share/doc/vfd-gateway"
    install -m 644 LICENSE-APACHE LICENSE-MIT target/notices/* "$to/usr/share/doc/vfd-gateway/"
    package "$from" "libc6:$debian"
    package "$from" "libgcc-s1:$debian"
    package "" ca-certificates
    install -D -m 644 "$from/etc/os-release" "$to/etc/os-release"
    # The C library asks DNS alone if this is missing, and names of /etc/hosts are unknown.
    echo 'hosts: files dns' >"$to/etc/nsswitch.conf"
    echo 'vfd-gateway:x:10001:10001::/var/lib/vfd-gateway:/nonexistent' >"$to/etc/passwd"
    echo 'vfd-gateway:x:10001:' >"$to/etc/group"
    mkdir -p "$to/etc/vfd-gateway"
}

# Takes the libraries that the file $1 names, and those that they name.
libraries_of() {
    for name in $(readelf -d "$1" | sed -n 's/.*(NEEDED).*\[\(.*\)]/\1/p'); do
        if [ "$name" = "${loader##*/}" ] || [ -e "$to/lib/$gnu/$name" ]; then
            continue
        fi
        install -D -m 644 "$from/lib/$gnu/$name" "$to/lib/$gnu/$name"
        libraries_of "$to/lib/$gnu/$name"
    done
}

# What is known of the package $2 in the Debian at $1: its licence, and its version, where scanners for known
# vulnerabilities look.
package() {
    name=${2%:*}
    install -D -m 644 "$1/usr/share/doc/$name/copyright" "$to/usr/share/doc/$name/copyright"
    mkdir -p "$to/var/lib/dpkg/status.d"
    dpkg-query --admindir="$1/var/lib/dpkg" -s "$2" >"$to/var/lib/dpkg/status.d/$name"
}

names
"$@"
