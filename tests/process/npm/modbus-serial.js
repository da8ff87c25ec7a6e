// Plays a Modbus TCP client with modbus-serial; see client.js.

import ModbusRTU from 'modbus-serial';
import { main, port } from './client.js';

let client;

async function open() {
  client = new ModbusRTU();
  await client.connectTCP('127.0.0.1', { port });
  client.setTimeout(6000);
}

async function send({ verb, unit, address, values: [first, second, ...rest], values }) {
  client.setID(unit);
  switch (verb) {
    case 'read': return { words: (await client.readHoldingRegisters(address, first)).data };
    case 'read_input': return { words: (await client.readInputRegisters(address, first)).data };
    case 'coils': return { bits: (await client.readCoils(address, first)).data.slice(0, first) };
    case 'discrete': return { bits: (await client.readDiscreteInputs(address, first)).data.slice(0, first) };
    case 'coil': return { bits: [(await client.writeCoil(address, first === 1)).state] };
    case 'flags': return { count: (await client.writeCoils(address, values.map((it) => it === 1))).length };
    case 'write':
      if (values.length === 1) {
        return { words: [(await client.writeRegister(address, first)).value] };
      }
      return { count: (await client.writeRegisters(address, values)).length };
    case 'mask': return { masks: Object.values(await client.maskWriteRegister(address, first, second)).slice(-2) };
    case 'both':
      return { words: (await client.readWriteRegisters(address, first, second, rest.length, rest)).data };
    case 'identity': return { identity: (await client.readDeviceIdentification(address, first)).data };
    case 'server_id': return await client.reportServerID(unit);
    default: throw new Error(`no such request: ${verb}`);
  }
}

async function ask(request) {
  try {
    return await send(request);
  } catch (error) {
    if (error.modbusCode === undefined) {
      throw error;
    }
    return { exception: error.modbusCode };
  }
}

await open();
await main(ask, async () => {
  await new Promise((done) => client.close(done));
  await open();
});
client.close(() => process.exit(0));
