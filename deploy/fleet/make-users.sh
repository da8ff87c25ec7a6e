#!/usr/bin/env bash
# Makes the users of a fleet: each gateway one of its own, who may only touch the gateway's own topics, and those who read.
set -euo pipefail
umask 077

usage() {
    cat <<'TEXT'
make-users.sh DIRECTORY PREFIX [READER...] < names of the gateways, one a line

Writes into DIRECTORY:
  credentials      user:password of everybody; from it each gateway gets its `password_file`
  mosquitto.passwd the same with hashes, for `password_file` of mosquitto (needs mosquitto_passwd)
  nats-users.conf  the same with what each may publish and subscribe, for nats.conf beside this script

PREFIX is the `prefix` of the gateways' [mqtt]. A READER (default: historian) may subscribe everything and publish nothing.
Who has a password in an existing `credentials` keeps it; whoever is no longer named is left out.
TEXT
}

fail() {
    echo "make-users.sh: $1" >&2
    usage >&2
    exit 2
}

# What goes into topics and configuration files as it stands. A dot would be another level at NATS.
checked() {
    [[ $1 =~ ^[A-Za-z0-9_-]{1,64}$ ]] || fail "\`$1\`: letters, digits, - and _ are taken here"
}

(($# >= 2)) || fail "a directory and a prefix are needed"
directory=$1 prefix=$2
shift 2
readers=("$@")
((${#readers[@]} > 0)) || readers=(historian)
[[ $prefix =~ ^[A-Za-z0-9_-]{1,64}(/[A-Za-z0-9_-]{1,64})*$ ]] || fail "\`$prefix\` is no prefix of topics"
subjects=${prefix//\//.}
mapfile -t gateways
((${#gateways[@]} > 0)) || fail "nobody is named on standard input"
for name in "${gateways[@]}" "${readers[@]}"; do checked "$name"; done
mkdir -p "$directory"
cd "$directory"

declare -A passwords=()
if [ -e credentials ]; then
    while IFS=: read -r user password; do passwords[$user]=$password; done <credentials
fi
all=("${gateways[@]}" "${readers[@]}")
mapfile -t fresh < <(openssl rand -hex $((16 * ${#all[@]})) | fold -w 32)
for at in "${!all[@]}"; do
    : "${passwords[${all[at]}]:=${fresh[at]}}"
done

for user in "${all[@]}"; do echo "$user:${passwords[$user]}"; done >credentials.new
mv credentials.new credentials

if command -v mosquitto_passwd >/dev/null; then
    cp credentials mosquitto.passwd.new
    mosquitto_passwd -U mosquitto.passwd.new
    mv mosquitto.passwd.new mosquitto.passwd
fi

# Deliveries at quality of service 1 come to an MQTT client on a subject of the server's own.
nats_user() {
    local user=$1 publish=$2 subscribe=$3
    cat <<TEXT
  { user: "$user", password: "${passwords[$user]}", allowed_connection_types: ["MQTT"]
    permissions: { publish: $publish, subscribe: ["$subscribe", "\$MQTT.sub.>"] } }
TEXT
}
{
    echo "users = ["
    for user in "${gateways[@]}"; do nats_user "$user" "[\"$subjects.$user.>\"]" "$subjects.$user.>"; done
    for user in "${readers[@]}"; do nats_user "$user" '{ deny: [">"] }' "$subjects.>"; done
    echo "]"
} >nats-users.conf.new
mv nats-users.conf.new nats-users.conf
