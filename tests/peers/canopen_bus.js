// Frames as lines of `candump -L` on standard input, frames to be sent as such lines on standard output: candump and
// canplayer are the transport, so that the CANopen stack needs no native module.
'use strict';
const Module = require('module');
const readline = require('readline');

// The one it has, for the CRC of block transfers, would have to be compiled where it is installed. Nobody here transfers blocks.
const load = Module._load;
const crc = () => { throw new Error('block transfers need node-crc'); };
Module._load = (name, ...rest) => (name === 'node-crc' ? { crc } : load(name, ...rest));

exports.connect = (devices, interfaceName) => {
  for (const device of devices) {
    device.addListener('message', ({ id, data }) => {
      const hex = Buffer.from(data).toString('hex').toUpperCase();
      process.stdout.write(`(0000000000.000000) ${interfaceName} ${id.toString(16).toUpperCase().padStart(3, '0')}#${hex}\n`);
    });
  }
  const lines = readline.createInterface({ input: process.stdin });
  lines.on('line', (line) => {
    const match = /^\([0-9.]+\) \S+ ([0-9A-F]{3})#([0-9A-F]*)$/.exec(line);
    if (!match) return;
    const data = Buffer.from(match[2], 'hex');
    const message = { id: parseInt(match[1], 16), data, len: data.length };
    for (const device of devices) device.receive(message);
  });
  return lines;
};
