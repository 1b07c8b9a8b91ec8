#!/usr/bin/env node
// A CANopen master that is not ours (npm canopen) against the emulated drives: aborts, set-up and remapping by SDO, NMT,
// SYNC, the state machine through PDOs, heartbeats both ways. Ends by SIGTERM with what it saw on standard error.
// usage: canopen_master.js INTERFACE NODE...
'use strict';
const { connect } = require('./canopen_bus.js');  // first: it says what the stack does without
const { Device, DataType } = require('canopen');

const { UNSIGNED8, UNSIGNED16, UNSIGNED32, INTEGER8, INTEGER16, INTEGER32 } = DataType;
const [interfaceName, ...nodes] = process.argv.slice(2);
const ids = nodes.map(Number);
const master = new Device({ id: 127 });
const seen = { aborts: {}, states: {}, heartbeats: {}, positions: {}, rated: {} };
const words = {};

for (const id of ids) {
  master.eds.addSdoClientParameter(id, 0x600 + id, 0x580 + id);
  master.eds.addHeartbeatConsumer(id, 3000);
  const object = (base, name, dataType) => master.eds.addEntry(base + 0x10 * id, { parameterName: `${name} ${id}`, dataType });
  words[id] = { control: object(0x2000, 'control', UNSIGNED16), torque: object(0x2001, 'torque', INTEGER16),
    status: object(0x2002, 'status', UNSIGNED16), position: object(0x2003, 'position', INTEGER32),
    actual: object(0x2004, 'actual', INTEGER16), speed: object(0x2005, 'speed', INTEGER32), mode: object(0x2006, 'mode', INTEGER8) };
  const w = words[id];
  master.eds.addTransmitPdo({ cobId: 0x200 + id, transmissionType: 1, dataObjects: [w.control, w.torque] });
  master.eds.addReceivePdo({ cobId: 0x180 + id, transmissionType: 1, dataObjects: [w.status, w.position, w.actual] });
  master.eds.addReceivePdo({ cobId: 0x280 + id, transmissionType: 1, dataObjects: [w.speed, w.mode] });
  seen.states[id] = [];
}
master.eds.setHeartbeatProducerTime(20);
const lines = connect([master], interfaceName);
master.start();
master.nmt.on('heartbeat', ({ deviceId, state }) => { (seen.heartbeats[deviceId] ||= []).push(state); });
master.pdo.on('pdo', () => {
  for (const id of ids) {
    const state = words[id].status.value & 0x6F;
    if (seen.states[id].at(-1) !== state) seen.states[id].push(state);
    seen.positions[id] = words[id].position.value;
    const next = { 0x40: 0x06, 0x21: 0x07, 0x23: 0x0F, 0x27: 0x0F }[state];
    if (next !== undefined) words[id].control.value = next;
  }
});

const timeout = 3000;
const write = (deviceId, index, subIndex, dataType, data) => master.sdo.download({ deviceId, index, subIndex, dataType, data, timeout });
const read = (deviceId, index, subIndex, dataType) => master.sdo.upload({ deviceId, index, subIndex, dataType, timeout });

async function mapPdo(id, communication, cob, type, entries) {
  await write(id, communication, 1, UNSIGNED32, (0x80000000 | cob) >>> 0);
  await write(id, communication + 0x200, 0, UNSIGNED8, 0);
  await write(id, communication, 2, UNSIGNED8, type);
  for (let i = 0; i < entries.length; ++i) await write(id, communication + 0x200, i + 1, UNSIGNED32, entries[i]);
  await write(id, communication + 0x200, 0, UNSIGNED8, entries.length);
  await write(id, communication, 1, UNSIGNED32, cob);
}
// Until it is there.
async function call(id) {
  for (;;) {
    try {
      return await master.sdo.upload({ deviceId: id, index: 0x1000, dataType: UNSIGNED32, timeout: 500 });
    } catch (error) { /* silent so far */ }
  }
}
async function setUp(id) {
  await call(id);
  const refused = async (what) => what.then(() => 0, (error) => error.code ?? error.message);
  seen.aborts[id] = [await refused(read(id, 0x2FFF, 0, UNSIGNED32)), await refused(read(id, 0x1018, 9, UNSIGNED32)),
    await refused(write(id, 0x6041, 0, UNSIGNED16, 0)), await refused(write(id, 0x1A00, 1, UNSIGNED32, 0x60410010))];
  await write(id, 0x1017, 0, UNSIGNED16, 20);
  await write(id, 0x1016, 1, UNSIGNED32, (127 << 16) | 3000);
  await write(id, 0x6007, 0, INTEGER16, 1);
  await write(id, 0x6060, 0, INTEGER8, 10);
  seen.rated[id] = [await read(id, 0x6076, 0, UNSIGNED32), await read(id, 0x6060, 0, INTEGER8), await read(id, 0x6502, 0, UNSIGNED32)];
  await mapPdo(id, 0x1400, 0x200 + id, 255, [0x60400010, 0x60710010]);
  await mapPdo(id, 0x1800, 0x180 + id, 1, [0x60410010, 0x60640020, 0x60770010]);
  await mapPdo(id, 0x1801, 0x280 + id, 1, [0x606C0020, 0x60610008]);
}
async function main() {
  await Promise.all(ids.map(setUp));
  for (const id of ids) master.nmt.startNode(id);
  master.nmt.startNode();  // itself, at once: a frame to 127 would have to come back from the bus before the first PDO
  // SYNC, then the controlwords that the last statuswords ask for.
  setInterval(() => {
    master.emit('message', { id: 0x80, data: Buffer.alloc(0) });
    for (const id of ids) master.pdo.write(0x200 + id);
  }, 10);
}
main().catch((error) => {
  process.stderr.write(`${error.stack}\n`);
  process.exit(1);
});
process.on('SIGTERM', () => {
  process.stderr.write(JSON.stringify(seen) + '\n');
  process.exit(0);
});
