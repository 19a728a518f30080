// What a file is, by its content first and its name second.

/** @typedef {import("../engine/protocol.js").Entry} Entry */
/** @typedef {"database"|"wal"|"zip"|"model"|"image"|"depth"|"settings"|"html"|"text"|"unknown"|"empty"} Kind */

const MODEL = /^(cameras|images|points3D|rigs|frames)\.(bin|txt)$/i;

/** @param {Uint8Array} bytes @param {number[]} mark */
const begins = (bytes, mark) => mark.every((value, k) => bytes[k] === value);

/** @param {Entry} entry @returns {Promise<Kind>} */
export async function classify({ path, file }) {
  const name = path.split("/").at(-1) ?? path;
  if (/-wal$/.test(name)) return "wal";
  if (file.size === 0) return "empty";
  const head = new Uint8Array(await file.slice(0, 64).arrayBuffer());
  const text = new TextDecoder("latin1").decode(head);
  if (text.startsWith("SQLite format 3\0")) return "database";
  if (begins(head, [0x50, 0x4b, 3, 4]) || begins(head, [0x50, 0x4b, 5, 6])) return "zip";
  if (MODEL.test(name)) return "model";
  const png = begins(head, [0x89, 0x50, 0x4e, 0x47]);
  if (png && head[24] === 16 && (head[25] === 0 || /depth/i.test(path))) return "depth";
  if (/depth/i.test(path) && (/\.(npy|npz|exr|tiff?)$/i.test(name) || png)) return "depth";
  if (png || begins(head, [0xff, 0xd8, 0xff]) || (text.startsWith("RIFF") && text.slice(8, 12) === "WEBP")) return "image";
  if (name === "depth.json") return "depth";
  if (/\.json$/i.test(name) && /^\s*\{/.test(text)) return (await isSettings(file)) ? "settings" : "text";
  if (/^\s*<(!doctype|html)/i.test(text)) return "html";
  return head.every((byte) => byte === 9 || byte === 10 || byte === 13 || (byte >= 32 && byte < 127)) ? "text" : "unknown";
}

/** Sections of a settings file (`Options` of crates/mapper, and `preset`). */
const SECTIONS = new Set(["preset", "seed", "intrinsics", "matches", "backend", "depth", "metric", "min_component_images", "calibrate", "relative_pose", "rotation", "tracks", "position", "refine", "retriangulate", "finish"]);
/** Settings are written by hand: larger files are something else. */
const MAX_SETTINGS_BYTES = 100_000;

/** @param {File} file */
async function isSettings(file) {
  if (file.size > MAX_SETTINGS_BYTES) return false;
  try {
    const names = Object.keys(JSON.parse(await file.text()));
    return names.length > 0 && names.every((name) => SECTIONS.has(name));
  } catch {
    return false;
  }
}

/** What to say of a file that is of no use. @param {string} path @param {Kind} kind @returns {import("../engine/protocol.js").Failure} */
export function refusal(path, kind) {
  /** @type {Record<string, [string, string]>} */
  const said = {
    empty: ["the file is empty", "copy it again"],
    html: ["it is a web page, not data", "the download probably asked for a login; open the address in a tab and save the file itself"],
    text: ["it is a text, but no COLMAP model and no settings", "drop the database.db that COLMAP wrote, or cameras.txt, images.txt and points3D.txt together"],
    unknown: ["it is no COLMAP database, model, image or depth map", "drop the database.db that COLMAP wrote (colmap feature_extractor and a matcher)"],
  };
  const [message, hint] = said[kind] ?? said.unknown;
  return { file: path, message, hint };
}
