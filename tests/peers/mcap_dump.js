#!/usr/bin/env node
// Prints an MCAP file as @mcap/core reads it, a JSON document a line: first what its index says, then every message in the order of
// time, by way of that index; at the end how many records a reader without an index finds. usage: mcap_dump.js FILE
"use strict";
const fs = require("fs");
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");

async function main(file) {
  const bytes = fs.readFileSync(file);
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (offset, length) => new Uint8Array(bytes.buffer, bytes.byteOffset + Number(offset), Number(length)),
  };
  const reader = await McapIndexedReader.Initialize({ readable });
  const topics = {};
  for (const channel of reader.channelsById.values()) {
    const schema = reader.schemasById.get(channel.schemaId);
    topics[channel.topic] = { encoding: channel.messageEncoding, schema: JSON.parse(new TextDecoder().decode(schema.data)), of: schema.encoding };
  }
  const s = reader.statistics;
  const out = [JSON.stringify({ topics, messages: Number(s.messageCount), chunks: reader.chunkIndexes.length, begin: String(s.messageStartTime),
    end: String(s.messageEndTime), offsets: reader.summaryOffsetsByOpcode.size })];
  for await (const m of reader.readMessages()) {
    out.push(JSON.stringify({ topic: reader.channelsById.get(m.channelId).topic, ns: String(m.logTime), sequence: m.sequence,
      text: new TextDecoder().decode(m.data) }));
  }
  const stream = new McapStreamReader({ includeChunks: true, validateCrcs: true });
  stream.append(bytes);
  const found = {};
  for (let r; (r = stream.nextRecord());) found[r.type] = (found[r.type] ?? 0) + 1;
  out.push(JSON.stringify({ found, done: stream.done() }));
  process.stdout.write(out.join("\n") + "\n");
}

main(process.argv[2]).catch((e) => {
  console.error(e);
  process.exit(1);
});
