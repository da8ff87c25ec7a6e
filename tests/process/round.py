"""Goes through what a broker has to do as paho-mqtt does it, and prints what came as one JSON object.

    round.py PORT 4|5

4 is MQTT 3.1.1.
"""

import json
import queue
import socket
import sys

import paho.mqtt.client as mqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

PORT, VERSION = int(sys.argv[1]), {"4": mqtt.MQTTv311, "5": mqtt.MQTTv5}[sys.argv[2]]
IS_5 = VERSION == mqtt.MQTTv5
ROOT = f"round/{sys.argv[2]}"


class Client:
    def __init__(self, name="", lasting=False, will=None):
        keeps = {} if IS_5 else {"clean_session": not lasting}
        self.client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, name, protocol=VERSION, **keeps)
        self.messages, self.subscribed, self.connected, self.gone = (queue.Queue() for _ in range(4))
        self.client.on_message = lambda client, data, message: self.messages.put(message)
        self.client.on_subscribe = lambda client, data, mid, reasons, properties: self.subscribed.put(reasons)
        self.client.on_connect = lambda client, data, flags, code, props: self.connected.put((flags, code, props))
        self.client.on_disconnect = lambda client, data, flags, code, props: self.gone.put(code)
        if will:
            self.client.will_set(will, "gone", qos=1)
        options = {}
        if IS_5:
            properties = Properties(PacketTypes.CONNECT)
            properties.SessionExpiryInterval = 600 if lasting else 0
            options = {"clean_start": not lasting, "properties": properties}
        # More than it asks for by itself, and no more than a broker of MQTT 5 offers here.
        self.client.max_inflight_messages_set(60)
        self.client.connect("127.0.0.1", PORT, **options)
        self.client.loop_start()
        self.flags, code, self.properties = self.connected.get(timeout=20)
        assert not code.is_failure, code

    def subscribe(self, topic, qos, identifier=None):
        properties = None
        if identifier and IS_5:
            properties = Properties(PacketTypes.SUBSCRIBE)
            properties.SubscriptionIdentifier = identifier
        self.client.subscribe(topic, qos, properties=properties)
        assert not self.subscribed.get(timeout=20)[0].is_failure

    def publish(self, topic, payload, qos, **more):
        self.client.publish(topic, payload, qos, **more).wait_for_publish(20)

    def get(self, count):
        return [self.messages.get(timeout=20) for _ in range(count)]

    def told(self, count):
        return [[it.payload.decode(), it.qos, it.retain] for it in self.get(count)]

    def end(self):
        self.client.disconnect()
        self.client.loop_stop()

    def break_off(self):
        """The connection ends without a farewell, and this client does not come back."""
        self.client.reconnect_delay_set(600, 600)
        self.client.socket().shutdown(socket.SHUT_RDWR)
        self.gone.get(timeout=20)
        self.client.loop_stop()


def properties_of(message):
    it = message.properties
    return {
        "user": [list(pair) for pair in it.UserProperty],
        "correlation": it.CorrelationData.decode(),
        "response": it.ResponseTopic,
        "content": it.ContentType,
        "format": it.PayloadFormatIndicator,
        "identifiers": it.SubscriptionIdentifier,
        "counts_down": 0 < it.MessageExpiryInterval <= 60,
    }


def main():
    round = {}
    writer, reader = Client(f"{ROOT}-writer"), Client(f"{ROOT}-reader")
    reader.subscribe(f"{ROOT}/live", 2)
    for qos in range(3):
        writer.publish(f"{ROOT}/live", str(qos), qos)
    round["live"] = reader.told(3)

    writer.publish(f"{ROOT}/kept", "value", 1, retain=True)
    reader.subscribe(f"{ROOT}/kept", 2)
    round["kept"] = reader.told(1)

    lasting = Client(f"{ROOT}-lasting", lasting=True)
    lasting.subscribe(f"{ROOT}/waited", 2)
    lasting.end()
    for qos in range(3):
        writer.publish(f"{ROOT}/waited", str(qos), qos)
    lasting = Client(f"{ROOT}-lasting", lasting=True)
    round["waited"] = [bool(lasting.flags.session_present), lasting.told(2)]
    lasting.end()

    reader.subscribe(f"{ROOT}/will", 2)
    Client(f"{ROOT}-dies", will=f"{ROOT}/will").break_off()
    round["will"] = reader.told(1)

    reader.subscribe(f"{ROOT}/many", 2)
    sent = [writer.client.publish(f"{ROOT}/many", str(number), qos=number % 2 + 1) for number in range(500)]
    for it in sent:
        it.wait_for_publish(20)
    round["many"] = len({it.payload for it in reader.get(500)})

    if IS_5:
        reader.subscribe(f"{ROOT}/properties", 1, identifier=7)
        properties = Properties(PacketTypes.PUBLISH)
        properties.UserProperty = [("a", "1"), ("a", "2")]
        properties.CorrelationData = b"42"
        properties.ResponseTopic = "answer"
        properties.ContentType = "text"
        properties.PayloadFormatIndicator = 1
        properties.MessageExpiryInterval = 60
        writer.publish(f"{ROOT}/properties", "x", 1, properties=properties)
        round["properties"] = properties_of(reader.get(1)[0])
        nameless = Client()
        round["assigned"] = nameless.properties.AssignedClientIdentifier.startswith("auto-")
        nameless.end()
        reader.client.reconnect_delay_set(600, 600)
        rival = Client(f"{ROOT}-reader")
        round["taken_over"] = reader.gone.get(timeout=20).value
        rival.end()
    else:
        reader.end()
    writer.end()
    print(json.dumps(round))


main()
