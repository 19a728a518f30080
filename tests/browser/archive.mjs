// Zip archives for the specs, read and written by the format's description and not by the page's own code (APPNOTE 6.3).

import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { deflateRawSync, inflateRawSync } from "node:zlib";

/** Unpacks an archive and checks every file's length and checksum. @param {string} archive @param {string} folder @returns {string[]} */
export function unpack(archive, folder) {
  const data = readFileSync(archive);
  const end = data.lastIndexOf(Buffer.from("PK\x05\x06", "latin1"));
  if (end < 0) throw new Error(`${archive} has no directory`);
  let at = data.readUInt32LE(end + 16);
  const names = [];
  for (let k = 0; k < data.readUInt16LE(end + 10); k += 1) {
    if (data.readUInt32LE(at) !== 0x02014b50) throw new Error(`entry ${k} of ${archive} is damaged`);
    const [method, crc, packed, size] = [data.readUInt16LE(at + 10), data.readUInt32LE(at + 16), data.readUInt32LE(at + 20), data.readUInt32LE(at + 24)];
    const [nameBytes, extra, comment, local] = [data.readUInt16LE(at + 28), data.readUInt16LE(at + 30), data.readUInt16LE(at + 32), data.readUInt32LE(at + 42)];
    const name = data.toString("utf8", at + 46, at + 46 + nameBytes);
    const start = local + 30 + data.readUInt16LE(local + 26) + data.readUInt16LE(local + 28);
    const raw = data.subarray(start, start + packed);
    const content = method === 8 ? inflateRawSync(raw) : raw;
    if (content.length !== size || checksum(content) !== crc) throw new Error(`${name} is damaged in ${archive}`);
    if (name.split("/").includes("..") || name.startsWith("/")) throw new Error(`${name} leaves its folder`);
    mkdirSync(dirname(join(folder, name)), { recursive: true });
    writeFileSync(join(folder, name), content);
    names.push(name);
    at += 46 + nameBytes + extra + comment;
  }
  return names;
}

/** An archive of deflated files; a stated size or checksum may lie. @param {{ name: string, content: Buffer, size?: number, crc?: number }[]} files @returns {Buffer} */
export function pack(files) {
  const parts = [];
  const directory = [];
  let offset = 0;
  for (const { name, content, size = content.length, crc = checksum(content) } of files) {
    const packed = deflateRawSync(content);
    const local = Buffer.alloc(30);
    local.writeUInt32LE(0x04034b50, 0);
    const central = Buffer.alloc(46);
    central.writeUInt32LE(0x02014b50, 0);
    for (const [header, at] of /** @type {const} */ ([[local, 4], [central, 6]])) {
      header.writeUInt16LE(20, at);
      header.writeUInt16LE(8, at + 4);
      header.writeUInt32LE(crc, at + 10);
      header.writeUInt32LE(packed.length, at + 14);
      header.writeUInt32LE(size, at + 18);
      header.writeUInt16LE(name.length, at + 22);
    }
    central.writeUInt32LE(offset, 42);
    parts.push(local, Buffer.from(name), packed);
    directory.push(central, Buffer.from(name));
    offset += 30 + name.length + packed.length;
  }
  const end = Buffer.alloc(22);
  end.writeUInt32LE(0x06054b50, 0);
  end.writeUInt16LE(files.length, 8);
  end.writeUInt16LE(files.length, 10);
  end.writeUInt32LE(directory.reduce((sum, part) => sum + part.length, 0), 12);
  end.writeUInt32LE(offset, 16);
  return Buffer.concat([...parts, ...directory, end]);
}

/** CRC-32 bit by bit: node has its own from 20.15 on only. @param {Buffer} bytes */
function checksum(bytes) {
  let c = 0xffffffff;
  for (const byte of bytes) {
    c ^= byte;
    for (let k = 0; k < 8; k += 1) c = c & 1 ? (c >>> 1) ^ 0xedb88320 : c >>> 1;
  }
  return (c ^ 0xffffffff) >>> 0;
}
