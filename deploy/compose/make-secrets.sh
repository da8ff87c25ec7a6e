#!/usr/bin/env bash
# Makes what compose.yaml calls secrets: an authority and a certificate for the broker, a password for each user of
# mosquitto/acl, and the broker's list of them. What is there already stays, so it can be run again after a change of acl.
set -euo pipefail

usage() {
    cat <<'TEXT'
make-secrets.sh [--as-me] [NAME...]

NAME: further names and addresses by which clients in the network reach the broker, for its certificate. This host's own
name, localhost, 127.0.0.1 and mosquitto are in it anyway.
--as-me: all files belong to who runs this, for a broker and a gateway that this user runs without containers. Those of a
container run as users of their own and cannot read them, also without root: there it is `podman unshare ./make-secrets.sh`.

A new password for a user: remove secrets/passwords/USER and run this again. A new certificate, for another NAME too: remove
secrets/mosquitto/broker.pem and give all NAMEs again. Afterwards `docker compose kill -s HUP mosquitto`; for the gateway's own password also
`docker compose exec gateway vfd-gateway reload`, and for that of telegraf `docker compose restart telegraf`.
TEXT
}

fail() {
    echo "make-secrets.sh: $1" >&2
    exit 2
}

image=eclipse-mosquitto:2.0.20
as_me=
names=(localhost 127.0.0.1 mosquitto "$(hostname)")
wanted=()
for argument in "$@"; do
    case $argument in
    --as-me) as_me=1 ;;
    -h | --help) usage && exit ;;
    -*) usage >&2 && fail "there is no option $argument" ;;
    *)
        [[ $argument =~ ^[A-Za-z0-9._:-]{1,253}$ ]] || fail "\`$argument\` is neither a name nor an address"
        wanted+=("$argument")
        ;;
    esac
done
[ -n "$as_me" ] || [ "$(id -u)" -eq 0 ] ||
    fail "the files shall belong to the users of the containers: run it with sudo, or see --help for --as-me"

cd "$(dirname "$0")"
acl=mosquitto/acl
# Each container reads its own files, and no other user of the host can read them.
umask 077
mkdir -p secrets/passwords

# Makes $2 from what comes in, for the user with number $1 alone, who may look into the directory too: where that
# is mounted, a file that takes the place of another is seen.
keep() {
    local file=secrets/$2 directory
    directory=$(dirname "$file")
    mkdir -p "$directory"
    if [ -z "$as_me" ]; then
        chgrp "$1" "$directory"
        chmod 750 "$directory"
    fi
    rm -f "$file.new"
    cat >"$file.new"
    [ -n "$as_me" ] || chown "$1:$1" "$file.new"
    chmod 400 "$file.new"
    mv -f "$file.new" "$file"
}

new_key() {
    openssl genpkey -quiet -algorithm EC -pkeyopt ec_paramgen_curve:P-256
}

authority() {
    [ ! -e secrets/broker-ca.pem ] || return 0
    new_key >secrets/authority.key
    openssl req -x509 -new -key secrets/authority.key -out secrets/broker-ca.pem -days 3650 \
        -subj "/CN=vfd-gateway broker authority $(openssl rand -hex 4)" \
        -addext "basicConstraints=critical,CA:TRUE,pathlen:0" -addext "keyUsage=critical,keyCertSign,cRLSign"
    # A certificate is no secret, and several containers read it.
    chmod 444 secrets/broker-ca.pem
}

is_address() {
    [[ $1 =~ ^[0-9.]+$ || $1 == *:* ]]
}

# A certificate that is there stays, so it must have every NAME already: clients at another one would refuse the broker.
has_wanted_names() {
    local file=secrets/mosquitto/broker.pem name check
    for name in "${wanted[@]}"; do
        if is_address "$name"; then check=-checkip; else check=-checkhost; fi
        openssl x509 -in "$file" -noout "$check" "$name" | grep "does match certificate" >/dev/null ||
            fail "\`$name\` is not in $file, which stays as it is and is for
$(openssl x509 -in "$file" -noout -ext subjectAltName | sed 1d)
For another certificate remove that file and run this again with all names."
    done
}

broker_certificate() {
    if [ -e secrets/mosquitto/broker.pem ]; then
        has_wanted_names
        return
    fi
    local list="" name kind
    for name in "${names[@]}" "${wanted[@]}"; do
        if is_address "$name"; then kind=IP; else kind=DNS; fi
        list+=${list:+,}$kind:$name
    done
    new_key | keep 1883 mosquitto/broker.key
    openssl req -new -key secrets/mosquitto/broker.key -subj "/CN=${names[0]}" |
        openssl x509 -req -CA secrets/broker-ca.pem -CAkey secrets/authority.key -days 825 \
            -set_serial "0x$(openssl rand -hex 16)" -extfile <(
            echo "basicConstraints=critical,CA:FALSE"
            echo "keyUsage=critical,digitalSignature"
            echo "extendedKeyUsage=serverAuth"
            echo "subjectAltName=$list"
        ) 2>/dev/null | keep 1883 mosquitto/broker.pem
}

# The password of the broker's user $1, made if there is none. What is typed into other programs is found there too.
password() {
    local file=secrets/passwords/$1
    [ -e "$file" ] || openssl rand -hex 24 >"$file"
    cat "$file"
}

# mosquitto's own hashes; the passwords are on no command line.
broker_users() {
    local user plain=secrets/hashing/plain
    mkdir -p secrets/hashing
    : >"$plain"
    while read -r user; do
        [[ $user =~ ^[A-Za-z0-9._-]{1,64}$ ]] || fail "$acl: \`$user\` cannot be a user here"
        echo "$user:$(password "$user")" >>"$plain"
    done < <(sed -n 's/^user  *//p' "$acl")
    if command -v mosquitto_passwd >/dev/null; then
        mosquitto_passwd -U "$plain"
    elif command -v docker >/dev/null; then
        docker run --rm --network none -u "$(id -u):$(id -g)" -v "$PWD/secrets/hashing:/here" "$image" \
            mosquitto_passwd -U /here/plain
    else
        rm -rf secrets/hashing
        fail "there is neither mosquitto_passwd (apt-get install mosquitto) nor docker to make the broker's hashes with"
    fi
    keep 1883 mosquitto/users <"$plain"
    rm -rf secrets/hashing
}

# The broker's user of the gateway, as its configuration says.
gateway_user=$(sed -n 's/^user = "\(.*\)"$/\1/p' gateway/vfd-gateway.toml)
grep -qx "user $gateway_user" "$acl" || fail "$acl has no user \`$gateway_user\`, which gateway/vfd-gateway.toml names"

authority
broker_certificate
broker_users
password "$gateway_user" | keep 10001 gateway/mqtt-password
keep 10001 gateway/broker-ca.pem <secrets/broker-ca.pem
keep 1883 mosquitto/broker-ca.pem <secrets/broker-ca.pem
printf '%s\n' "-h localhost" "-p 8883" "--cafile /run/secrets/broker-ca.pem" "-u health" "-P $(password health)" |
    keep 1883 mosquitto/mosquitto_sub
echo "MQTT_PASSWORD=$(password telegraf)" | keep 10002 telegraf/environment
password grafana-admin | keep 472 grafana/password
echo "made in $PWD/secrets; passwords for other programs are in secrets/passwords, the authority for them is secrets/broker-ca.pem"
