"""Applies Home Assistant's own schemas and templates to announcements.

Each line on standard input is an object with the topic, the payload and what stands on the state topic. Printed is,
for each object, what its template makes of that and of an empty payload. An announcement that Home Assistant would not
take, or a template that fails, ends the program.
"""

import asyncio
import json
import logging
import sys

from homeassistant.components.mqtt import (
    binary_sensor,
    button,
    event,
    fan,
    number,
    sensor,
    switch,
)
from homeassistant.components.mqtt.discovery import TOPIC_MATCHER
from homeassistant.components.mqtt.models import MqttValueTemplate
from homeassistant.core import HomeAssistant

PLATFORMS = {
    "binary_sensor": binary_sensor,
    "button": button,
    "event": event,
    "fan": fan,
    "number": number,
    "sensor": sensor,
    "switch": switch,
}


class Complaints(logging.Handler):
    """Counts what Home Assistant complains of: a template that fails gives back its input."""

    count = 0

    def emit(self, record):
        self.count += 1
        print(self.format(record), file=sys.stderr)


def rendered(hass, template, value):
    """What the template makes of the value."""
    return MqttValueTemplate(template, hass=hass).async_render_with_possible_json_value(value)


async def main():
    """Reads the announcements."""
    complaints = Complaints(logging.WARNING)
    logging.getLogger().addHandler(complaints)
    hass = HomeAssistant("/nonexistent")
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
            state = rendered(hass, template, it["state"])
        is_passing = document.get("state_topic", "").endswith(("/result", "/trip/event"))
        if template is not None and not is_passing:
            cleared = rendered(hass, template, "")
        shown[name] = {"state": state, "cleared": cleared}
    print(json.dumps(shown))
    return complaints.count


sys.exit(asyncio.run(main()))
