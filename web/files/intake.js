// Files from a drop, a picker, a folder or a zip, as one list of entries, sorted by what they are.

import { Refusal } from "../engine/client.js";
import { unzip } from "./zip.js";
import { classify, refusal } from "./classify.js";

/** @typedef {import("../engine/protocol.js").Entry} Entry */
/** @typedef {import("../engine/protocol.js").Failure} Failure */

/** What the system leaves in folders and archives, of no interest to anybody. */
const NOISE = /(^|\/)(__MACOSX|\.DS_Store|Thumbs\.db|desktop\.ini|\.git)(\/|$)|-shm$/i;
/** A scan of a whole disk is a mistake: nobody means to drop more files than this. */
const MAX_FILES = 200_000;

/** @param {DataTransfer} transfer @returns {Promise<Entry[]>} */
export async function fromDrop(transfer) {
  // Entries must be asked for before the first await: the list is emptied after the event.
  const roots = [...transfer.items].filter((item) => item.kind === "file").map((item) => ({ entry: item.webkitGetAsEntry?.(), file: item.getAsFile() }));
  /** @type {Entry[]} */
  const found = [];
  for (const { entry, file } of roots) {
    if (entry) await walk(entry, found);
    else if (file) found.push({ path: file.name, file });
  }
  return found;
}

/** @param {FileSystemEntry} entry @param {Entry[]} found */
async function walk(entry, found) {
  if (found.length > MAX_FILES) throw new Refusal({ file: entry.fullPath, message: `more than ${MAX_FILES} files`, hint: "drop only the scene's folder" });
  const path = entry.fullPath.replace(/^\//, "");
  if (NOISE.test(path)) return;
  if (entry.isFile) {
    const file = await new Promise((resolve, reject) => /** @type {FileSystemFileEntry} */ (entry).file(resolve, reject));
    found.push({ path, file });
    return;
  }
  const reader = /** @type {FileSystemDirectoryEntry} */ (entry).createReader();
  for (;;) {
    /** @type {FileSystemEntry[]} */
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) return;
    for (const child of some) await walk(child, found);
  }
}

/** @param {FileList} list @returns {Entry[]} */
export function fromPicker(list) {
  return [...list].map((file) => ({ path: file.webkitRelativePath || file.name, file })).filter(({ path }) => !NOISE.test(path));
}

/**
 * @typedef {object} Sorted
 * @property {Entry[]} open database with its -wal, or the files of a model
 * @property {Entry[]} pictures @property {Entry[]} depths @property {Entry|null} settings
 * @property {Failure[]} refused
 */

/** Unpacks archives and sorts everything by what it is. @param {Entry[]} entries @param {(text: string) => void} [told] @returns {Promise<Sorted>} */
export async function sort(entries, told = () => {}) {
  /** @type {Sorted} */
  const sorted = { open: [], pictures: [], depths: [], settings: null, refused: [] };
  /** @type {Record<string, Entry[]>} */
  const by = { database: [], wal: [], model: [] };
  /** @param {Entry[]} list @param {boolean} inArchive */
  const take = async (list, inArchive) => {
    for (const entry of list) {
      if (NOISE.test(entry.path)) continue;
      const kind = await classify(entry);
      if (kind === "zip" && !inArchive) await take(await unzip(entry, told), true);
      else if (kind === "image") sorted.pictures.push(entry);
      else if (kind === "depth") sorted.depths.push(entry);
      else if (kind === "settings") sorted.settings = entry;
      else if (kind in by) by[kind].push(entry);
      // In a folder or an archive other files are no mistake; dropped by hand they are.
      else if (entries.length <= 3 && !inArchive && !entry.path.includes("/")) sorted.refused.push(refusal(entry.path, kind));
    }
  };
  await take(entries, false);
  if (by.database.length > 1) {
    const names = by.database.map(({ path }) => path).join(", ");
    sorted.refused.push({ file: names, message: "more than one database", hint: "drop one at a time" });
  } else if (by.database.length === 1) {
    const [database] = by.database;
    sorted.open = [database, ...by.wal.filter(({ path }) => path === `${database.path}-wal`)];
  } else if (by.model.length > 0) {
    sorted.open = oneModel(by.model);
  } else if (by.wal.length > 0) {
    sorted.refused.push({ file: by.wal[0].path, message: "a write-ahead log without its database", hint: "drop the database.db together with it" });
  }
  if (entries.length === 0) sorted.refused.push({ file: "the folder", message: "it is empty", hint: "drop a database.db, or a folder that holds one" });
  return sorted;
}

/** The files of the folder that holds most of a model. @param {Entry[]} entries */
function oneModel(entries) {
  /** @type {Map<string, Entry[]>} */
  const folders = new Map();
  for (const entry of entries) {
    const folder = entry.path.split("/").slice(0, -1).join("/");
    folders.set(folder, [...(folders.get(folder) ?? []), entry]);
  }
  return [...folders.values()].sort((a, b) => b.length - a.length)[0];
}
