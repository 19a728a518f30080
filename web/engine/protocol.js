// What the page and the engine's worker say to one another. Types only; both sides import them.

/**
 * @typedef {{ id: number, name: string, width: number, height: number, keypoints: number, camera: number }} ImageInfo
 * @typedef {{ id: number, model: string, width: number, height: number, params: number[] }} CameraInfo
 *
 * What was opened. `pairs` are three numbers a pair: image, image, verified matches.
 * @typedef {object} Opened
 * @property {"database"|"model"} kind
 * @property {string} name
 * @property {ImageInfo[]} images
 * @property {CameraInfo[]} cameras
 * @property {Uint32Array} pairs
 * @property {number} bytes of the file
 * @property {number} predictedBytes what a solve will need
 * @property {string[]} warnings
 * @property {Report} [report] what there is to say of a model
 *
 * A refusal: which file, why, what to do.
 * @typedef {{ file: string, message: string, hint: string }} Failure
 *
 * A scene to draw. Positions and colours lie point by point; `pointComponent` and `cameraComponent` number components.
 * @typedef {object} Snapshot
 * @property {Float32Array} positions xyz a point, world
 * @property {Uint8Array} colors rgb a point
 * @property {Float32Array} errors mean reprojection error a point, px, −1 unknown
 * @property {Uint16Array} tracks observations a point
 * @property {Uint16Array} pointComponent
 * @property {Uint32Array} cameraImage index into the opened images
 * @property {Float32Array} cameras 12 numbers a camera: world_from_cam, 3 × 4 by rows
 * @property {Float32Array} cameraShape 4 numbers a camera: half width, half height over focal length; offset of the principal point
 * @property {Uint16Array} cameraComponent
 * @property {Float32Array} cameraErrors mean reprojection error a camera, px, −1 unknown
 * @property {boolean} final
 *
 * @typedef {object} ImageReport
 * @property {number} id @property {string} name @property {number|null} component
 * @property {number} points @property {number|null} mean_reprojection_error_px
 * @property {({reason: string} & Record<string, any>)|null} unregistered
 *
 * @typedef {object} Report
 * @property {number} num_images @property {number} num_registered @property {boolean} stopped
 * @property {{images: number, points: number, observations: number, mean_reprojection_error_px: number, mean_track_length: number}[]} components
 * @property {ImageReport[]} images
 * @property {{stage: string, component: number, seconds: number, summary: string}[]} stages
 * @property {string[]} warnings
 *
 * Events of the mapper, as the command line prints them with --json.
 * @typedef {{ event: "stage_started", stage: string, component: number }
 *   | { event: "progress", stage: string, done: number, total: number }
 *   | { event: "iteration", stage: string, iteration: number, cost: number, damping: number, active_observations: number, accepted: boolean }
 *   | { event: "stage_finished", stage: string, component: number, seconds: number, summary: string }
 *   | { event: "component_finished", component: number, images: number, points: number }
 *   | { event: "warning", message: string }
 *   | { event: "device_lost", stage: string, reason: string, resumed_on: string|null, message: string }
 *   | { event: "depth_input", depth_input: { maps: number, missing: string[], keypoints: number, keypoints_with_depth: number } }} MapperEvent
 *
 * @typedef {{ path: string, file: File }} Entry
 *
 * Commands, answered under their `id` with `{ id, value }` or `{ id, failure }`. A solve starts `helpers` further workers at most,
 * while it has work for them: as many as there are processors, if not given; none below 2.
 * @typedef {{ type: "open", entries: Entry[] }
 *   | { type: "pictures", entries: Entry[] }
 *   | { type: "depths", entries: Entry[] }
 *   | { type: "solve", settings: Record<string, any>, backend: "auto"|"gpu"|"cpu", helpers?: number }
 *   | { type: "refine", settings: Record<string, any>, backend: "auto"|"gpu"|"cpu" }
 *   | { type: "snapshot" }
 *   | { type: "keypoints", image: number }
 *   | { type: "matches", image: number, other: number }
 *   | { type: "residuals", image: number }
 *   | { type: "track", point: number }
 *   | { type: "export", formats: string[], component: number|null, filter: {maxErrorPx: number, minTrack: number}, settings: Record<string, any> }
 *   | { type: "status" }} Command
 *
 * What the engine holds, and the longest time for which the last run did not look at what it was asked.
 * @typedef {{ memoryBytes: number, longestGap: { ms: number, stage: string|null } }} Status
 *
 * Sent at any time, not answered.
 * @typedef {{ type: "pause" } | { type: "resume" } | { type: "stop" } | { type: "cancel" }} Signal
 *
 * Sent by the worker on its own.
 * @typedef {{ type: "ready", adapter: Adapter } | { type: "backend", adapter: Adapter } | { type: "event", event: MapperEvent } | { type: "snapshot", snapshot: Snapshot }
 *   | { type: "paused" } | { type: "panic", message: string }} Message
 *
 * Where things are computed: with `ready` what this browser offers, with `backend` what the run that begins has taken.
 * `none` is the processor.
 * @typedef {{ kind: "gpu"|"software"|"none", name: string, why: string }} Adapter
 */

export {};
