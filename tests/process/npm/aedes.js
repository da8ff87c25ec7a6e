// An MQTT broker that is aedes: 3.1.1 only. It prints what it has heard of clients, one JSON object per line.
//
//     aedes.js PORT

import net from 'node:net';
import Aedes from 'aedes';

const aedes = new Aedes();
const say = (what) => console.log(JSON.stringify(what));

aedes.on('clientReady', (client) => say({ ready: client.id, version: client.version, clean: client.clean }));
aedes.on('clientDisconnect', (client) => say({ gone: client.id }));
aedes.on('connectionError', (client, error) => say({ refused: error.message }));
aedes.on('clientError', (client, error) => say({ error: error.message, client: client.id }));
aedes.on('subscribe', (asked, client) => say({ subscribed: asked.map((it) => it.topic), client: client.id }));
net.createServer(aedes.handle).listen(Number(process.argv[2]), '127.0.0.1', () => say({ listens: true }));
