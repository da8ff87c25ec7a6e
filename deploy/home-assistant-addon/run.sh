#!/bin/sh
# Writes the gateway's configuration from the add-on's options and the broker that the Supervisor knows, and runs the gateway.
set -eu

data=${DATA:-/data}
own=${OWN_CONFIGURATIONS:-/config}
supervisor=${SUPERVISOR:-http://supervisor}
listen=0.0.0.0:${INGRESS_PORT:-8099}
options=$data/options.json
umask 077

fail() {
    echo "run.sh: $1" >&2
    exit 1
}

# A file of the user's own, in the add-on's configuration directory, stands for all options.
file=$(jq -r '.own_configuration // ""' "$options")
if [ -n "$file" ]; then
    case $file in
        */*) fail "own_configuration: $file is not the name of a file in the add-on's configuration directory" ;;
    esac
    [ -r "$own/$file" ] || fail "own_configuration: there is no $file in the add-on's configuration directory"
    exec vfd-gateway run -c "$own/$file"
fi

mqtt=$(curl -fsS --max-time 10 -H "Authorization: Bearer ${SUPERVISOR_TOKEN:?}" "$supervisor/services/mqtt") ||
    fail "the Supervisor knows no MQTT broker: install the add-on Mosquitto broker, or set up another one"
printf '%s\n' "$mqtt" | jq -r '.data.password // ""' >"$data/mqtt-password"

# A JSON string is a TOML string too, so that no value can end one early.
printf '%s\n' "$mqtt" | jq -r --slurpfile options "$options" --arg data "$data" --arg listen "$listen" '
    def line(key; value): if value == null then empty else "\(key) = \(value | @json)" end;
    .data as $mqtt | $options[0] as $all |
    "[gateway]", line("name"; "home-assistant"), line("data_dir"; $data + "/vfd-gateway"), "",
    "[[line]]", line("name"; "line-1"), line("port"; $all.port), line("baud"; $all.baud | tonumber),
    line("parity"; $all.parity), line("stop_bits"; $all.stop_bits | tonumber), "",
    ($all.drives[] |
        "[[line.drive]]", line("name"; .name), line("model"; .model), line("station"; .station), "",
        if .max_hz == null then empty else
            "[line.drive.control]", "from = [\"mqtt\"]",
            "frequency_hz = { min = \(.min_hz // 0), max = \(.max_hz) }",
            "directions = \(if .directions == "both" then ["forward", "reverse"] else ["forward"] end | @json)",
            line("on_commander_lost"; .on_commander_lost), line("lost_after"; .lost_after),
            line("on_shutdown"; .on_shutdown),
            if .accept_basic then "accept_unverified = [\"basic\"]" else empty end, ""
        end),
    "[mqtt]",
    line("broker"; "\(if $mqtt.ssl then "mqtts" else "mqtt" end)://\($mqtt.host):\($mqtt.port)"),
    if ($mqtt.username // "") == "" then empty else
        line("user"; $mqtt.username), line("password_file"; $data + "/mqtt-password"),
        if $mqtt.ssl then empty else "allow_plain_password = true" end
    end,
    "home_assistant = { discovery = true, combined = \($all.combined // [] | @json) }", "",
    "# Home Assistant shows the page to those who are signed in there, through its own proxy at this address.",
    "[http]", line("listen"; $listen), "allow = [\"172.30.32.2/32\"]"
' >"$data/vfd-gateway.toml"

exec vfd-gateway run -c "$data/vfd-gateway.toml"
