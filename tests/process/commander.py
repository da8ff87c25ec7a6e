"""Sends one command as paho-mqtt does, and prints its last result as a JSON object.

    commander.py PORT 4|5 TOPIC PAYLOAD retain|live

4 is MQTT 3.1.1. The result is the first one that comes after the command and is the last of its command.
"""

import json
import queue
import sys

import paho.mqtt.client as mqtt


def main():
    port, version, topic, payload, retain = sys.argv[1:]
    protocol = {"4": mqtt.MQTTv311, "5": mqtt.MQTTv5}[version]
    events = queue.Queue()
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, protocol=protocol)
    client.on_message = lambda client, userdata, message: events.put(message)
    client.on_subscribe = lambda client, userdata, mid, reasons, properties: events.put(None)
    client.connect("127.0.0.1", int(port))
    client.loop_start()
    client.subscribe("vfd/plant/drive/+/result", 1)
    assert events.get(timeout=20) is None
    client.publish(topic, payload, qos=1, retain=retain == "retain")
    while True:
        result = json.loads(events.get(timeout=20).payload)
        if result["final"]:
            break
    print(json.dumps(result))
    if retain == "retain":
        client.publish(topic, b"", qos=1, retain=True).wait_for_publish(20)
    client.disconnect()
    client.loop_stop()


main()
