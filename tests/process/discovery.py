"""Applies Home Assistant's own schemas and templates to announcements.

Each line on standard input is an object with the topic, the payload and what stands on the state topic. Printed is,
for each object, what its template makes of that and of an empty payload. An announcement that Home Assistant would not
take ends the program.
"""

import json
import sys

from homeassistant.components.mqtt import (
    binary_sensor,
    button,
    event,
    number,
    sensor,
)
from homeassistant.components.mqtt.discovery import TOPIC_MATCHER
from homeassistant.components.mqtt.models import MqttValueTemplate

PLATFORMS = {
    "binary_sensor": binary_sensor,
    "button": button,
    "event": event,
    "number": number,
    "sensor": sensor,
}
OWN_KEYS = {"device", "origin"}
shown = {}
for line in sys.stdin:
    it = json.loads(line)
    levels = TOPIC_MATCHER.match(it["topic"].removeprefix("homeassistant/"))
    assert levels, it["topic"]
    component, _node, name = levels.groups()
    document = json.loads(it["payload"])
    config = PLATFORMS[component].DISCOVERY_SCHEMA(dict(document))
    assert config["unique_id"] and config["device"]["identifiers"], it
    state = cleared = None
    template = config.get("value_template")
    if template is not None and it["state"] is not None:
        value = MqttValueTemplate(template)
        state = value.async_render_with_possible_json_value(it["state"])
    passing = document.get("state_topic", "").endswith(("/result", "/trip/event"))
    if template is not None and not passing:
        cleared = MqttValueTemplate(template).async_render_with_possible_json_value("")
    shown[name] = {"state": state, "cleared": cleared}
print(json.dumps(shown))
