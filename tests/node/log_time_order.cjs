// Reads an MCAP file through its indexes in the order of log time, with every checksum, and prints what it found as JSON.
//
// An independent reader: the package @mcap/core is the one that Foxglove opens files with.
const { McapIndexedReader } = require("@mcap/core");
const fs = require("fs/promises");

async function main(path) {
  const file = await fs.open(path);
  const readable = {
    size: async () => BigInt((await file.stat()).size),
    read: async (offset, length) => {
      const bytes = new Uint8Array(Number(length));
      await file.read(bytes, 0, Number(length), Number(offset));
      return bytes;
    },
  };
  const reader = await McapIndexedReader.Initialize({ readable });
  const found = { topics: {}, unordered: 0, chunks: reader.chunkIndexes.length, attachments: [], metadata: [] };
  let last = 0n;
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    found.unordered += message.logTime < last ? 1 : 0;
    last = message.logTime;
    const topic = reader.channelsById.get(message.channelId).topic;
    found.topics[topic] = (found.topics[topic] ?? 0) + 1;
  }
  for await (const attachment of reader.readAttachments({ validateCrcs: true })) {
    found.attachments.push(attachment.name);
  }
  for await (const metadata of reader.readMetadata()) {
    found.metadata.push(metadata.name);
  }
  console.log(JSON.stringify(found));
}

main(process.argv[2]).catch((error) => {
  console.error(error);
  process.exit(1);
});
