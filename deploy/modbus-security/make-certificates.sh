#!/usr/bin/env bash
# Makes an authority for trying out Modbus Security, and certificates of it: elliptic keys on P-256, signed with SHA-256.
# The authority's key lies beside the certificates, so do not run a plant with it.
set -euo pipefail

usage() {
    cat <<'TEXT'
make-certificates.sh DIRECTORY gateway NAME...      gateway.pem and gateway.key; NAME: names and addresses that clients connect to
make-certificates.sh DIRECTORY client NAME [ROLE]   NAME.pem and NAME.key of a client, with ROLE in extension 1.3.6.1.4.1.50316.802.1

The authority, ca.pem and ca.key, is made in DIRECTORY if it is not there. DAYS=N: how long certificates hold (825).
Letters, digits, - _ . are taken for NAME, and blanks for ROLE as well.
TEXT
}

fail() {
    echo "make-certificates.sh: $1" >&2
    usage >&2
    exit 2
}

# Whatever else would mean something to openssl.
checked() {
    [[ $1 =~ ^[A-Za-z0-9._:\ -]{1,64}$ ]] || fail "\`$1\` cannot be used here"
}

new_key() {
    openssl genpkey -quiet -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out "$1"
}

authority() {
    [ ! -e ca.pem ] || return 0
    new_key ca.key
    openssl req -x509 -new -key ca.key -out ca.pem -days 3650 -subj "/CN=Modbus Security test authority" \
        -addext "basicConstraints=critical,CA:TRUE" -addext "keyUsage=critical,keyCertSign,cRLSign"
}

# Issues $1.pem for the common name $2 with the extensions $3.
issue() {
    local extensions="basicConstraints=critical,CA:FALSE
keyUsage=critical,digitalSignature
$3"
    new_key "$1.key"
    openssl req -new -key "$1.key" -subj "/CN=$2" |
        openssl x509 -req -CA ca.pem -CAkey ca.key -set_serial "0x$(openssl rand -hex 16)" -days "${DAYS:-825}" \
            -extfile <(echo "$extensions") -out "$1.pem" 2>"$1.log" || { cat "$1.log" >&2; exit 1; }
    rm "$1.log"
}

gateway() {
    local names="" name kind
    for name in "$@"; do
        checked "$name"
        if [[ $name =~ ^[0-9.]+$ || $name == *:* ]]; then kind=IP; else kind=DNS; fi
        names+=${names:+,}$kind:$name
    done
    issue gateway "$1" "extendedKeyUsage=serverAuth
subjectAltName=$names"
}

client() {
    checked "$1"
    case $1 in ca | gateway | *' '* | *:*) fail "\`$1\` cannot be a client's name" ;; esac
    local extensions=extendedKeyUsage=clientAuth
    if (($# > 1)); then
        checked "$2"
        # A UTF8String that is not critical, as Modbus Security asks for.
        extensions+=$'\n'"1.3.6.1.4.1.50316.802.1=ASN1:UTF8String:$2"
    fi
    issue "$1" "$1" "$extensions"
}

(($# >= 3)) || fail "too few arguments"
directory=$1 what=$2
shift 2
case $what in
gateway) ;;
client) (($# <= 2)) || fail "too many arguments" ;;
*) fail "\`$what\` is neither \`gateway\` nor \`client\`" ;;
esac
umask 077
mkdir -p "$directory"
cd "$directory"
authority
"$what" "$@"
