// Reads an MCAP file with the packages that Lichtblick reads it with and prints all of it as JSON: every message decoded
// by the schema in the file. A file with a wrong CRC is refused with exit code 1.
import { readFile } from "node:fs/promises";

import { crc32 } from "@foxglove/crc";
import { McapIndexedReader } from "@mcap/core";
import { loadDecompressHandlers, protobufFromBinaryDescriptor } from "@mcap/support";

const AS_TEXT = { longs: String, enums: String, bytes: String, defaults: true, json: true };

async function read(path) {
  const bytes = new Uint8Array(await readFile(path));
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (offset, length) => bytes.subarray(Number(offset), Number(offset + length)),
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: await loadDecompressHandlers() });

  const dataCrc = crc32(bytes.subarray(0, Number(reader.dataEndOffset)));
  if (reader.dataSectionCrc !== dataCrc) {
    throw new Error(`the data section's CRC is ${reader.dataSectionCrc}, its bytes make ${dataCrc}`);
  }

  const topics = {};
  const types = new Map();
  for (const channel of reader.channelsById.values()) {
    const schema = reader.schemasById.get(channel.schemaId);
    topics[channel.topic] = { schema: schema.name, metadata: Object.fromEntries(channel.metadata), messages: [] };
    types.set(channel.id, protobufFromBinaryDescriptor(schema.data).lookupType(schema.name));
  }
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const type = types.get(message.channelId);
    const decoded = type.toObject(type.decode(message.data), AS_TEXT);
    topics[reader.channelsById.get(message.channelId).topic].messages.push([String(message.logTime), decoded]);
  }
  const metadata = {};
  for await (const record of reader.readMetadata()) {
    metadata[record.name] = Object.fromEntries(record.metadata);
  }
  const attachments = {};
  for await (const attachment of reader.readAttachments({ validateCrcs: true })) {
    attachments[attachment.name] = attachment.data.length;
  }
  const counted = Number(reader.statistics.messageCount);
  return { profile: reader.header.profile, counted, topics, metadata, attachments };
}

try {
  process.stdout.write(JSON.stringify(await read(process.argv[2])));
} catch (error) {
  process.stderr.write(`${error.stack}\n`);
  process.exitCode = 1;
}
