#!/bin/sh
# Installs a released vfd-gateway, after its signature and its checksum were checked:
#
#   install.sh --from ADDRESS --signers FILE [--prefix DIRECTORY] [--check]
#
# ADDRESS is the directory of a release: https://..., or a directory of this host. FILE has the public key of those who release,
# as in ALLOWED SIGNERS of ssh-keygen(1); take it from elsewhere than the release. The Debian package is installed where dpkg
# is there, else the program alone; with --prefix always the program alone, into DIRECTORY/bin. --check installs nothing.
set -eu

identity=release@vfd-gateway
namespace=vfd-gateway-release

fail() {
    echo "install.sh: $1" >&2
    exit "${2:-1}"
}

usage() {
    sed -n '2,/^set/s/^# \{0,1\}//p' "$0" | sed '$d' >&2
    exit 2
}

from='' signers='' prefix='' only_check=''
while [ $# -gt 0 ]; do
    case $1 in
        --from) from=${2:?"--from needs an address"} && shift 2 ;;
        --signers) signers=${2:?"--signers needs a file"} && shift 2 ;;
        --prefix) prefix=${2:?"--prefix needs a directory"} && shift 2 ;;
        --check) only_check=1 && shift ;;
        *) usage ;;
    esac
done
if [ -z "$from" ] || [ -z "$signers" ]; then usage; fi
[ -r "$signers" ] || fail "$signers: there is no such file, or it cannot be read" 2
command -v ssh-keygen >/dev/null || fail "there is no ssh-keygen, which checks the signature: install openssh-client"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
trap 'exit 1' INT TERM

# One file of the release. Nothing of it is used before its checksum was compared.
fetch() {
    case $from in
        https://* | http://127.0.0.1:*)
            if command -v curl >/dev/null; then
                curl -fsSL --proto '=https,http' -o "$work/$1" "$from/$1" || fail "$from/$1 cannot be fetched"
            elif command -v wget >/dev/null; then
                wget -q -O "$work/$1" "$from/$1" || fail "$from/$1 cannot be fetched"
            else
                fail "there is neither curl nor wget"
            fi
            ;;
        *://*) fail "$from: https:// is needed" 2 ;;
        *) cp "$from/$1" "$work/$1" || fail "$from/$1 cannot be read" ;;
    esac
}

fetch SHA256SUMS
fetch SHA256SUMS.sig
ssh-keygen -q -Y verify -f "$signers" -I "$identity" -n "$namespace" -s "$work/SHA256SUMS.sig" <"$work/SHA256SUMS" >/dev/null ||
    fail "the signature of SHA256SUMS is not that of $identity in $signers: nothing was installed"

# The name of the file in the release that ends like this.
named() {
    cut -c67- "$work/SHA256SUMS" | grep "^[A-Za-z0-9][A-Za-z0-9._+~-]*\$" | grep "$1\$" | tail -n 1
}

machine=$(uname -m)
if [ -z "$prefix" ] && command -v dpkg >/dev/null; then
    wanted="_$(dpkg --print-architecture).deb"
    kind="Debian package"
else
    wanted="^vfd-gateway-$machine"
    kind="program"
fi
file=$(named "$wanted") || true
[ -n "$file" ] || fail "the release has no $kind for this machine ($machine): it can be built from source"
fetch "$file"
(cd "$work" && grep "  $file\$" SHA256SUMS | sha256sum --check --strict --quiet -) ||
    fail "$file is not what was signed: nothing was installed"
echo "install.sh: $file is signed by $identity, and as it was"
[ -z "$only_check" ] || exit 0

case $file in
    *.deb)
        [ "$(id -u)" = 0 ] || fail "the package is installed by root: run this with sudo, or use --prefix"
        # The file must be readable for the user that apt fetches as.
        chmod 755 "$work" && chmod 644 "$work/$file"
        apt-get install -y "$work/$file"
        ;;
    *)
        install -D -m 755 "$work/$file" "${prefix:-/usr/local}/bin/vfd-gateway"
        echo "install.sh: installed as ${prefix:-/usr/local}/bin/vfd-gateway"
        ;;
esac
