"""Asks as a requester with MQTT 5 does, and prints each response as one JSON object a line.

    requester.py PORT TOPIC PAYLOAD RESPONSE_TOPIC CORRELATION

It ends with the response that is the last one for the command, or, if none came, after the last one on `result`.
"""

import json
import queue
import sys

import paho.mqtt.client as mqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties


def main():
    port, topic, payload, response_topic, correlation = sys.argv[1:]
    events = queue.Queue()
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, protocol=mqtt.MQTTv5)
    client.on_message = lambda client, userdata, message: events.put(message)
    client.on_subscribe = lambda client, userdata, mid, reasons, properties: events.put(None)
    client.connect("127.0.0.1", int(port))
    client.loop_start()
    client.subscribe([(response_topic, 1), ("vfd/plant/drive/+/result", 1)])
    assert events.get(timeout=20) is None
    properties = Properties(PacketTypes.PUBLISH)
    properties.ResponseTopic = response_topic
    properties.CorrelationData = correlation.encode()
    client.publish(topic, payload, qos=1, properties=properties)
    told, answered = False, False
    while not answered:
        try:
            # After the last result a response, if there is one, follows at once.
            message = events.get(timeout=2 if told else 20)
        except queue.Empty:
            if told:
                break
            raise
        if message.topic == topic:
            continue
        body = json.loads(message.payload)
        if message.topic != response_topic:
            told = told or body["final"]
            continue
        data = getattr(message.properties, "CorrelationData", b"")
        print(json.dumps({"correlation": data.decode(), "payload": body}))
        answered = body["final"]
    client.disconnect()
    client.loop_stop()


main()
