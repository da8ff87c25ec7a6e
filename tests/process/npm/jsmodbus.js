// Plays Modbus TCP clients with jsmodbus, one connection for each unit; see client.js.

import net from 'node:net';
import Modbus from 'jsmodbus';
import { main, port } from './client.js';

const clients = new Map();

async function client(unit) {
  if (!clients.has(unit)) {
    const socket = new net.Socket();
    const opened = new Promise((done, failed) => socket.once('connect', done).once('error', failed));
    const it = new Modbus.client.TCP(socket, unit, 6000);
    socket.connect({ host: '127.0.0.1', port });
    clients.set(unit, opened.then(() => ({ it, socket })));
  }
  return (await clients.get(unit)).it;
}

async function close() {
  for (const opened of clients.values()) {
    (await opened).socket.destroy();
  }
  clients.clear();
}

async function send({ verb, unit, address, values: [first], values }) {
  const it = await client(unit);
  const body = async (answer) => (await answer).response.body;
  switch (verb) {
    case 'read': return { words: (await body(it.readHoldingRegisters(address, first))).valuesAsArray };
    case 'read_input': return { words: (await body(it.readInputRegisters(address, first))).valuesAsArray };
    case 'coils': return bits(await body(it.readCoils(address, first)), first);
    case 'discrete': return bits(await body(it.readDiscreteInputs(address, first)), first);
    case 'coil': return { bits: [(await body(it.writeSingleCoil(address, first === 1))).value !== 0] };
    case 'flags': return { count: (await body(it.writeMultipleCoils(address, values.map((it) => it === 1)))).quantity };
    case 'write':
      if (values.length === 1) {
        return { words: [(await body(it.writeSingleRegister(address, first))).value] };
      }
      return { count: (await body(it.writeMultipleRegisters(address, values))).quantity };
    default: throw new Error(`no such request: ${verb}`);
  }
}

function bits(body, count) {
  return { bits: body.valuesAsArray.slice(0, count).map((bit) => bit === 1) };
}

async function ask(request) {
  try {
    return await send(request);
  } catch (error) {
    if (error.err !== 'ModbusException') {
      throw new Error(JSON.stringify({ err: error.err, message: error.message }));
    }
    return { exception: error.response.body.code };
  }
}

await main(ask, close);
await close();
