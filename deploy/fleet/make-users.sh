#!/usr/bin/env bash
# Makes the users of a fleet: each gateway one of its own, who may only touch the gateway's own topics, those who read, and
# those who command under their own name.
set -euo pipefail
umask 077

usage() {
    cat <<'TEXT'
make-users.sh [--commander NAME]... [--sparkplug GROUP HOST] DIRECTORY PREFIX [READER...] < names of the gateways, one a line

Writes into DIRECTORY:
  credentials      user:password of everybody; from it each gateway gets its `password_file`
  gateways.passwd  gateways and sites with hashes, for their listener of mosquitto (needs mosquitto_passwd)
  others.passwd    readers and commanders, for the other listener; with --sparkplug the host and the gateways too
  mosquitto.acl    what each may at mosquitto
  nats-users.conf  all with what each may publish and subscribe, for nats.conf beside this script

PREFIX is the `prefix` of the gateways' [mqtt]. A READER (default: historian) may subscribe everything and publish nothing. A
COMMANDER may subscribe everything, and publish below by/NAME of each gateway and to all/run/set; up to 32 characters. With
--sparkplug the gateways are edge nodes of GROUP, and HOST is the user and the id of their host; mosquitto only.
A user with a password in an existing `credentials` keeps it; a user that is no longer named is left out.

The brokers read the files as users of their own. No other user may read them:
  install -o mosquitto -g mosquitto -m 400 gateways.passwd others.passwd mosquitto.acl /etc/mosquitto/
  install -o nats -g nats -m 400 nats-users.conf /etc/nats/
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

commanders=() group='' hosts=()
while (($# > 0)); do
    case $1 in
    --commander)
        (($# >= 2)) || fail "--commander wants a name"
        # The gateway takes names of this length below by/.
        ((${#2} <= 32)) || fail "\`$2\`: a commander has 32 characters at most"
        commanders+=("$2")
        shift 2
        ;;
    --sparkplug)
        (($# >= 3)) || fail "--sparkplug wants a group and a host"
        group=$2 hosts=("$3")
        checked "$group"
        shift 3
        ;;
    -*) fail "there is no option \`$1\`" ;;
    *) break ;;
    esac
done
(($# >= 2)) || fail "a directory and a prefix are needed"
directory=$1 prefix=$2
shift 2
readers=("$@")
((${#readers[@]} > 0)) || readers=(historian)
[[ $prefix =~ ^[A-Za-z0-9_-]{1,64}(/[A-Za-z0-9_-]{1,64})*$ ]] || fail "\`$prefix\` is no prefix of topics"
subjects=${prefix//\//.}
mapfile -t gateways
((${#gateways[@]} > 0)) || fail "standard input names no gateway"
others=("${readers[@]}" "${commanders[@]}" "${hosts[@]}")
all=("${gateways[@]}" "${others[@]}")
for name in "${all[@]}"; do checked "$name"; done
# One who is two would have what both may.
twice=$(printf '%s\n' "${all[@]}" | sort | uniq -d)
[ -z "$twice" ] || fail "named twice: ${twice//$'\n'/, }"
mkdir -p "$directory"
cd "$directory"

declare -A passwords=()
if [ -e credentials ]; then
    while IFS=: read -r user password; do passwords[$user]=$password; done <credentials
fi
mapfile -t fresh < <(openssl rand -hex $((16 * ${#all[@]})) | fold -w 32)
for at in "${!all[@]}"; do
    : "${passwords[${all[at]}]:=${fresh[at]}}"
done

credentials_of() {
    local user
    for user in "$@"; do echo "$user:${passwords[$user]}"; done
}
credentials_of "${all[@]}" >credentials.new
mv credentials.new credentials

if command -v mosquitto_passwd >/dev/null; then
    credentials_of "${gateways[@]}" >gateways.passwd.new
    # Two connections of one user are too many for the listener of the gateways.
    credentials_of "${others[@]}" ${group:+"${gateways[@]}"} >others.passwd.new
    for file in gateways.passwd others.passwd; do
        mosquitto_passwd -U "$file.new"
        mv "$file.new" "$file"
    done
fi

# `PREFIX/+/` are gateways, `PREFIX/+/+/` those behind the bridge of a site. No rule is a pattern: one would hold for
# every user, and a reader could play a gateway of the reader's name.
mosquitto_gateway() {
    local user=$1 kind
    printf '\nuser %s\ntopic readwrite %s/%s/#\n' "$user" "$prefix" "$user"
    [ -n "$group" ] || return 0
    for kind in NBIRTH NDATA NDEATH; do echo "topic write spBv1.0/$group/$kind/$user"; done
    for kind in DBIRTH DDATA DDEATH; do echo "topic write spBv1.0/$group/$kind/$user/+"; done
    echo "topic read spBv1.0/$group/NCMD/$user"
    echo "topic read spBv1.0/$group/DCMD/$user/+"
    echo "topic read spBv1.0/STATE/${hosts[0]}"
}
mosquitto_commander() {
    local user=$1 gateway
    printf '\nuser %s\ntopic read %s/#\n' "$user" "$prefix"
    for gateway in "$prefix/+" "$prefix/+/+"; do
        printf 'topic write %s\n' "$gateway/by/$user/#" "$gateway/all/run/set"
    done
}
mosquitto_host() {
    local user=$1
    printf '\nuser %s\ntopic read spBv1.0/%s/#\n' "$user" "$group"
    printf 'topic write spBv1.0/%s/%s\n' "$group" NCMD/+ "$group" DCMD/+/+
    echo "topic readwrite spBv1.0/STATE/$user"
}
{
    echo "# Made by make-users.sh. Who is not named here may nothing."
    for user in "${gateways[@]}"; do mosquitto_gateway "$user"; done
    for user in "${readers[@]}"; do printf '\nuser %s\ntopic read %s/#\n' "$user" "$prefix"; done
    for user in "${commanders[@]}"; do mosquitto_commander "$user"; done
    for user in "${hosts[@]}"; do mosquitto_host "$user"; done
} >mosquitto.acl.new
mv mosquitto.acl.new mosquitto.acl

# Deliveries at quality of service 1 come to an MQTT client on a subject of the server's own. Who reads may do so over NATS
# itself too: the documents, what answers its requests, and the stream HISTORY with its consumers.
nats_user() {
    local user=$1 types=$2 publish=$3 subscribe=$4
    cat <<TEXT
  { user: "$user", password: "${passwords[$user]}", allowed_connection_types: [$types]
    permissions: { publish: $publish, subscribe: [$subscribe, "\$MQTT.sub.>"] } }
TEXT
}
# A filter of MQTT that ends in # is for the level above it too.
everything="\"$subjects\", \"$subjects.>\""
nats_commander() {
    local user=$1 gateway publish=''
    for gateway in "$subjects.*" "$subjects.*.*"; do publish+="\"$gateway.by.$user.>\", \"$gateway.all.run.set\", "; done
    nats_user "$user" '"MQTT"' "[${publish%, }]" "$everything"
}
# shellcheck disable=SC2016 # These are names of NATS.
reading='["$JS.API.CONSUMER.INFO.HISTORY.*", "$JS.API.CONSUMER.MSG.NEXT.HISTORY.*", "$JS.ACK.HISTORY.>"]'
{
    echo "users = ["
    for user in "${gateways[@]}"; do nats_user "$user" '"MQTT"' "[\"$subjects.$user.>\"]" "\"$subjects.$user.>\""; done
    for user in "${readers[@]}"; do nats_user "$user" '"MQTT", "STANDARD"' "$reading" "$everything, \"_INBOX.>\""; done
    for user in "${commanders[@]}"; do nats_commander "$user"; done
    echo "]"
} >nats-users.conf.new
mv nats-users.conf.new nats-users.conf
