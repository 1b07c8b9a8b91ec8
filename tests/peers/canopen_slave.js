#!/usr/bin/env node
// Two CiA 402 drives on a CANopen stack that is not ours (npm canopen): SDO server, NMT, heartbeat, PDOs as the
// controller maps them, SYNC are the stack's; here are objects and the power state machine. They stand still where
// they are told to. What they were told goes to standard error in the end.
// usage: canopen_slave.js INTERFACE RATED_MNM NODE=COUNTS...
'use strict';
const { connect } = require('./canopen_bus.js');  // first: it says what the stack does without
const { Device, DataType, ObjectType, AccessType, NmtState } = require('canopen');

const { UNSIGNED8, UNSIGNED16, UNSIGNED32, INTEGER8, INTEGER16, INTEGER32 } = DataType;

function drive(node, counts, rated) {
  const device = new Device({ id: node });
  const { eds } = device;
  const variable = (index, dataType, defaultValue, accessType = AccessType.READ_WRITE) => eds.getEntry(index) ||
    eds.addEntry(index, { parameterName: index.toString(16), dataType, defaultValue, accessType });
  const array = (index, types, values) => {
    const entry = eds.getEntry(index) || eds.addEntry(index, { parameterName: index.toString(16), objectType: ObjectType.ARRAY });
    types.forEach((dataType, i) => entry[i + 1] ||
      eds.addSubEntry(index, i + 1, { parameterName: `${index.toString(16)} ${i + 1}`, dataType, defaultValue: values[i] }));
    return entry;
  };
  eds.addSdoServerParameter(127, 0x580 + node, 0x600 + node);
  eds.setSyncCobId(0x80);
  variable(0x1006, UNSIGNED32, 0);
  variable(0x1014, UNSIGNED32, 0x80 + node);
  array(0x1016, [UNSIGNED32], [0]);
  variable(0x1017, UNSIGNED16, 0);
  for (let i = 0; i < 2; ++i) {
    array(0x1400 + i, [UNSIGNED32, UNSIGNED8], [0x80000200 + 0x100 * i + node, 255]);
    array(0x1800 + i, [UNSIGNED32, UNSIGNED8], [0x80000180 + 0x100 * i + node, 255]);
    for (const first of [0x1600, 0x1A00]) array(first + i, [UNSIGNED32, UNSIGNED32, UNSIGNED32, UNSIGNED32], [0, 0, 0, 0]);
  }
  variable(0x6007, INTEGER16, 3);
  const control = variable(0x6040, UNSIGNED16, 0);
  const status = variable(0x6041, UNSIGNED16, 0x250);
  variable(0x605A, INTEGER16, 6);
  variable(0x605E, INTEGER16, 2);
  const mode = variable(0x6060, INTEGER8, 0);
  const display = variable(0x6061, INTEGER8, 0);
  variable(0x6064, INTEGER32, counts);
  variable(0x606C, INTEGER32, 0);
  const target = variable(0x6071, INTEGER16, 0);
  variable(0x6072, UNSIGNED16, 3000);
  variable(0x6076, UNSIGNED32, rated, AccessType.READ_ONLY);
  const actual = variable(0x6077, INTEGER16, 0);
  variable(0x6502, UNSIGNED32, 0x225, AccessType.READ_ONLY);

  const told = { node, controls: [], torques: 0, largest: 0, enabled: false };
  mode.addListener('update', () => { display.value = mode.value; });
  const follow = () => {
    const word = control.value;
    if (told.controls.at(-1) !== word) told.controls.push(word);
    let state = status.value & 0x6F;
    if ((word & 0x02) === 0) state = 0x40;
    else if ((word & 0x87) === 0x06) state = 0x21;
    else if ((word & 0x8F) === 0x07 && state !== 0x40) state = 0x23;
    else if ((word & 0x8F) === 0x0F && state === 0x23) state = 0x27;
    status.value = 0x210 | state;
    told.enabled = told.enabled || state === 0x27;
    actual.value = state === 0x27 ? target.value : 0;
    told.torques += 1;
    told.largest = Math.max(told.largest, Math.abs(target.value));
  };
  control.addListener('update', follow);
  device.pdo.on('pdo', follow);
  device.nmt.on('changeState', (state) => {
    if (state === NmtState.OPERATIONAL) {
      told.receives = eds.getReceivePdos().map((p) => [p.cobId, p.transmissionType, ...p.dataObjects.map((o) => o.index)]);
      told.transmits = eds.getTransmitPdos().map((p) => [p.cobId, p.transmissionType, ...p.dataObjects.map((o) => o.index)]);
    }
  });
  device.start();
  return { device, told };
}

const [interfaceName, rated, ...nodes] = process.argv.slice(2);
const drives = nodes.map((n) => n.split('=').map(Number)).map(([node, counts]) => drive(node, counts, Number(rated)));
connect(drives.map((d) => d.device), interfaceName);
process.on('SIGTERM', () => {
  process.stderr.write(JSON.stringify(drives.map((d) => d.told)) + '\n');
  process.exit(0);
});
