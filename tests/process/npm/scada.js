// A Sparkplug host: MQTT.js, and the payloads of Eclipse Tahu's own library. It prints each message of its group as a JSON
// object, metrics by the names that the births gave them, and is told what to do as lines on its standard input.
//
//     scada.js PORT HOST GROUP VERSION
//
//     {"state": true}                      says that it is online, or with false that it is not
//     {"to": "NCMD/NODE", "metrics": [...], "retain": false, "qos": 0, "age_ms": 0}
//                                          a command, or "DCMD/NODE/DEVICE"
//     {"vanish": true}                     drops the connection, so that the broker publishes its will

import readline from 'node:readline';
import mqtt from 'mqtt';
import payloads from 'sparkplug-payload';

const [port, host, group, version] = process.argv.slice(2);
const { encodePayload, decodePayload } = payloads.get('spBv1.0');
const say = (what) => console.log(JSON.stringify(what));
const number = (value) => (value === undefined || value === null ? null : Number(value));
const started = Date.now();
const state = (online, timestamp) => JSON.stringify({ online, timestamp });
const topic = `spBv1.0/STATE/${host}`;
// The birth of a session has the moment of its will.
let isFirst = true;

// Names by alias, as the births of this group told them.
const names = new Map();

const client = mqtt.connect({
  host: '127.0.0.1',
  port: Number(port),
  protocolVersion: Number(version),
  clientId: `host-${host}`,
  clean: true,
  reconnectPeriod: 200,
  will: { topic, payload: state(false, started), qos: 1, retain: true },
});

function metric(it, node, isBirth) {
  const alias = number(it.alias);
  const key = `${node} ${alias}`;
  if (isBirth && alias !== null) {
    names.set(key, it.name);
  }
  const value = typeof it.value === 'object' && it.value !== null ? Number(it.value) : it.value;
  const properties = {};
  for (const [name, property] of Object.entries(it.properties ?? {})) {
    properties[name] = property.value;
  }
  return {
    name: it.name ?? names.get(key) ?? null,
    named: it.name !== undefined,
    alias,
    type: it.type,
    value: value ?? null,
    historical: it.isHistorical === true,
    at: number(it.timestamp),
    properties,
  };
}

client.on('message', (place, bytes, packet) => {
  const [, , kind, node, device] = place.split('/');
  if (['NCMD', 'DCMD'].includes(kind)) return;
  const payload = decodePayload(bytes);
  const isBirth = kind === 'NBIRTH' || kind === 'DBIRTH';
  const metrics = (payload.metrics ?? []).map((it) => metric(it, node, isBirth));
  const find = (name) => metrics.find((it) => it.name === name)?.value ?? null;
  say({
    kind,
    node,
    device: device ?? null,
    seq: number(payload.seq),
    bdseq: kind === 'NBIRTH' || kind === 'NDEATH' ? find('bdSeq') : null,
    at: number(payload.timestamp),
    qos: packet.qos,
    retain: packet.retain,
    metrics,
  });
});

client.on('connect', () => {
  client.subscribe(`spBv1.0/${group}/#`, { qos: 1 }, () => say({ subscribed: true }));
});
client.on('error', () => {});

readline.createInterface({ input: process.stdin }).on('line', (line) => {
  const order = JSON.parse(line);
  if (order.vanish) {
    client.options.reconnectPeriod = 0;
    client.stream.destroy();
    return;
  }
  if (order.state !== undefined) {
    const at = isFirst ? started : Date.now();
    isFirst = false;
    client.publish(topic, state(order.state, order.at ?? at), { qos: 1, retain: true }, () => say({ state: order.state }));
    return;
  }
  const timestamp = Date.now() - (order.age_ms ?? 0);
  const metrics = order.metrics.map((it) => ({ timestamp, ...it }));
  const [kind, ...rest] = order.to.split('/');
  const place = ['spBv1.0', group, kind, ...rest].join('/');
  const bytes = encodePayload({ timestamp, metrics });
  client.publish(place, bytes, { qos: order.qos ?? 0, retain: order.retain ?? false }, () => say({ sent: order.to }));
});
