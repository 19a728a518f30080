// Why an image is not placed, in words, and what to do about it; and how well the others are.

import { plural } from "../ui/format.js";

/** @typedef {import("../engine/protocol.js").ImageReport} ImageReport */
/** @typedef {"pending"|"placed"|"weak"|"missing"} Standing */

/** Fewer points than this hold a camera badly: six unknowns, and some of the points will be wrong. */
const FEW_POINTS = 30;
/** An image this many times worse than the median deserves a look. */
const LARGE_ERROR = 2.5;

/** @param {ImageReport|undefined} image @param {number} medianErrorPx @returns {{ standing: Standing, why: string }} */
export function standing(image, medianErrorPx) {
  if (!image) return { standing: "pending", why: "" };
  if (image.component === null) return { standing: "missing", why: reason(image.unregistered) };
  if (image.points < FEW_POINTS) return { standing: "weak", why: `only ${plural(image.points, "point")}: match it with more images` };
  const error = image.mean_reprojection_error_px ?? 0;
  if (error > LARGE_ERROR * medianErrorPx) return { standing: "weak", why: `error ${error.toFixed(2)} px, ${(error / medianErrorPx).toFixed(1)} times the median` };
  return { standing: "placed", why: `${plural(image.points, "point")}, ${error.toFixed(2)} px` };
}

/** @param {({reason: string} & Record<string, any>)|null} why */
function reason(why) {
  switch (why?.reason) {
    case "no_keypoints": return "no keypoints in the database: extract features again";
    case "no_pairs": return "matched with no other image: match it, or take photographs in between";
    case "weak_pairs": return `its strongest pair has ${plural(why.best, "verified match", "verified matches")}: too few for a pose; match with more features or add photographs nearby`;
    case "inconsistent_rotations": return "its pairs contradict the others: probably wrong matches on repeated structure";
    case "small_component": return `connected only with ${plural(Math.max(why.images - 1, 0), "other image")}: add photographs that link it to the rest`;
    case "no_tracks": return "none of its keypoints is matched across three images";
    case "no_observations_left": return "all its observations were taken out as outliers";
    case "component_failed": return `its component could not be reconstructed: ${why.message}`;
    case "stopped": return "the run was stopped before its turn";
    default: return "not placed";
  }
}

/** @param {(number|null|undefined)[]} values */
export function median(values) {
  const known = values.filter((value) => value !== null && value !== undefined).map(Number).sort((a, b) => a - b);
  return known[Math.floor(known.length / 2)] ?? 0;
}
