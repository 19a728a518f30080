// What happens to a scene: it is opened, joined by photographs and depth maps, solved, paused, stopped, given up. Everything
// that changes the phase is here.

import { Refusal } from "./engine/client.js";
import { sort } from "./files/intake.js";
import { count, plural } from "./ui/format.js";

/**
 * @typedef {import("./engine/protocol.js").Entry} Entry
 * @typedef {import("./engine/protocol.js").Failure} Failure
 * @typedef {import("./engine/protocol.js").Snapshot} Snapshot
 * @typedef {import("./run/settings.js").Choice} Choice
 */

const RUNNING = ["running", "paused", "stopping"];

export class Session {
  /**
   * @param {import("./store.js").Store} store @param {import("./engine/client.js").Engine} engine
   * @param {import("./inputs/pictures.js").Pictures} pictures
   * @param {{ reading: (text: string, done?: number, total?: number) => void, draw: (snapshot: Snapshot) => void, cleared: () => void,
   *   began: (isModel: boolean) => void, ended: (text: string, complete: boolean) => void, say: (text: string, kind?: "plain"|"fair"|"bad") => void,
   *   picturesChanged: () => void, settings: (settings: Record<string, any>) => void }} on
   */
  constructor(store, engine, pictures, on) {
    this.store = store;
    this.engine = engine;
    this.pictures = pictures;
    this.on = on;
    /** Raised when a newer scene was asked for: what is still on its way from the older one is dropped. */
    this.scene = 0;
    /** @type {AbortController|null} */
    this.loading = null;
    this.cancelled = false;
    /** Photographs came while a run was on its way. */
    this.late = false;
  }

  get running() {
    return RUNNING.includes(this.store.state.phase);
  }

  /** @param {Failure} failure */
  problem(failure) {
    this.store.set({ problems: [...this.store.state.problems, failure] });
    this.on.say(`${failure.file}: ${failure.message}${failure.hint ? `; ${failure.hint}` : ""}`, "bad");
  }

  /** @param {unknown} error @param {string} file */
  refuse(error, file) {
    if (error instanceof Refusal) this.problem(error.failure);
    else this.problem({ file, message: /** @type {Error} */ (error)?.message ?? String(error), hint: "" });
  }

  /** @param {Snapshot} snapshot */
  snapshot(snapshot) {
    const { opened, placed } = this.store.state;
    if (opened === null || this.cancelled) return;
    // Ten pictures a second: the page hears of it only when cameras have come or gone.
    if (snapshot.final || snapshot.cameraImage.length !== placed.size) this.store.set({ placed: new Set(snapshot.cameraImage) });
    this.on.draw(snapshot);
  }

  /** Everything of the scene before goes. @param {Partial<import("./store.js").State>} [next] what takes its place */
  clear(next) {
    this.scene += 1;
    this.pictures.clear();
    this.late = this.cancelled = false;
    this.on.cleared();
    this.store.forget(next);
  }

  /**
   * Reads what was dropped, picked or named by address. A scene that is open, or being solved, goes only when there is another.
   * @param {(signal: AbortSignal) => Promise<Entry[]>} entries @param {string} [what] what is being read
   */
  async open(entries, what = "the files") {
    this.loading?.abort();
    const loading = (this.loading = new AbortController());
    const stale = () => loading.signal.aborted;
    this.store.set({ problems: [], reading: true });
    this.on.reading(`Reading ${what}`);
    let named = what;
    try {
      const given = await entries(loading.signal);
      named = given[0]?.path.split("/")[0] ?? named;
      const sorted = await sort(given, (text) => stale() || this.on.reading(text));
      if (stale()) return;
      for (const failure of sorted.refused) this.problem(failure);
      named = sorted.open[0]?.path ?? named;
      if (sorted.open.length > 0) await this.replace(sorted.open, loading.signal);
      if (stale()) return;
      if (sorted.settings) this.on.settings(JSON.parse(await sorted.settings.file.text()));
      if (sorted.pictures.length + sorted.depths.length > 0) await this.attach(sorted.pictures, sorted.depths);
      else if (sorted.settings) return;
      else if (sorted.open.length === 0 && sorted.refused.length === 0) {
        this.problem({ file: named, message: "there is no database, model or photograph in it", hint: "drop a database.db, or a folder that holds one" });
      }
    } catch (error) {
      if (!stale()) this.refuse(error, named);
    } finally {
      if (!stale()) this.store.set({ reading: false });
    }
  }

  /** @param {Entry[]} entries @param {AbortSignal} signal */
  async replace(entries, signal) {
    this.on.reading(`Reading ${entries[0].path}`);
    const opened = await this.engine.open(entries, signal);
    // Every database is called database.db: its folder tells them apart.
    if (opened.kind === "database") opened.name = entries[0].path.split("/").slice(-2).join("/");
    this.engine.adopt();
    this.clear({ opened, report: opened.report ?? null, phase: "ready", reading: false });
    for (const warning of opened.warnings) this.on.say(warning, "fair");
    if (opened.kind === "model") await this.engine.ask({ type: "snapshot" });
  }

  /** Stops reading: what was there before stays, nothing new comes. */
  giveUp() {
    this.loading?.abort();
    this.store.set({ reading: false });
  }

  /** Nothing is open afterwards, and the memory is given back. */
  close() {
    this.giveUp();
    this.clear();
    this.engine.restart();
  }

  /** @param {Entry[]} photographs @param {Entry[]} depths */
  async attach(photographs, depths) {
    const { opened } = this.store.state;
    if (!opened) {
      this.problem({ file: photographs[0]?.path ?? depths[0]?.path, message: photographs.length > 0 ? "photographs alone cannot be reconstructed: their matches are missing" : "depth maps alone cannot be reconstructed", hint: "match them with COLMAP (feature_extractor, then exhaustive_matcher) and drop its database.db, with or without them" });
      return;
    }
    const mine = this.scene;
    const found = this.pictures.add(photographs, opened.images.map((image) => image.name));
    if (photographs.length > 0 && this.pictures.files.size === 0) this.problem({ file: photographs[0].path, message: "none of these photographs is in the database", hint: `it names ${opened.images[0]?.name ?? "none"}, for example: names must agree` });
    if (found > 0) {
      this.on.say(`${plural(found, "photograph")} for ${count(opened.images.length)} images`);
      this.store.set({ pictures: this.pictures.files.size });
      this.on.picturesChanged();
      // A run that is on its way has its colours already planned: the engine takes photographs before it and after it.
      if (this.running) this.late = true;
      else {
        // Colours come into a scene that is in use.
        this.store.set({ reading: false });
        await this.sendPictures();
      }
      if (mine !== this.scene) return;
    }
    if (depths.length > 0) {
      if (opened.kind === "model") this.problem({ file: depths[0].path, message: "depth maps take part in a reconstruction, and this is a finished model", hint: "drop its database.db with them" });
      else {
        await this.engine.ask({ type: "depths", entries: depths });
        if (mine !== this.scene) return;
        this.store.set({ depths: this.store.state.depths + depths.filter(({ path }) => !/\.json$/i.test(path)).length });
        this.on.say(`${plural(depths.length, "file")} of depth; the next run uses ${depths.length === 1 ? "it" : "them"}`);
      }
    }
  }

  /** The engine colours with them what it has solved already. */
  async sendPictures() {
    this.late = false;
    await this.engine.ask({ type: "pictures", entries: [...this.pictures.files].map(([path, file]) => ({ path, file })) });
  }

  /** @param {Choice} choice */
  async solve(choice) {
    const mine = this.scene;
    const { opened } = this.store.state;
    if (!opened || this.running) return;
    this.cancelled = false;
    // A model is refined where it stands; a database begins with nothing.
    const isModel = opened.kind === "model";
    const { report: before } = this.store.state;
    if (!isModel) this.on.cleared();
    this.store.set({ phase: "running", report: null, problems: [], selection: { kind: "none" }, seenBy: [], component: null, imageFilter: "all", ...(isModel ? {} : { placed: new Set() }) });
    this.on.began(isModel);
    try {
      const report = await this.engine.ask({ type: isModel ? "refine" : "solve", ...choice });
      if (mine !== this.scene) return;
      this.store.set({ report, phase: "done" });
      this.on.ended(isModel ? `Refined${report.stopped ? " as far as it got" : ""}.` : `${report.stopped ? "Stopped: " : ""}${count(report.num_registered)} of ${plural(report.num_images, "image")} placed.`, !report.stopped);
    } catch (error) {
      if (mine !== this.scene) return;
      if (this.cancelled) this.on.say("Cancelled.");
      else this.refuse(error, opened.name);
      if (isModel) {
        this.cancelled = false;
        this.store.set({ phase: "ready", report: before });
        this.on.ended("", false);
        await this.engine.ask({ type: "snapshot" });
      } else {
        this.on.cleared();
        if (this.store.state.opened) this.store.set({ phase: "ready", placed: new Set() });
      }
    }
    if (this.late && mine === this.scene) await this.sendPictures();
  }

  stop() {
    if (!["running", "paused"].includes(this.store.state.phase)) return;
    this.store.set({ phase: "stopping" });
    this.engine.signal({ type: "stop" });
  }

  /** Gives the solve up: the worker ends at its next breath and the scene is as it was opened. */
  cancel() {
    if (!this.running) return;
    this.cancelled = true;
    this.store.set({ phase: "stopping" });
    this.engine.signal({ type: "cancel" });
  }

  togglePause() {
    const { phase } = this.store.state;
    if (phase !== "running" && phase !== "paused") return;
    this.store.set({ phase: phase === "running" ? "paused" : "running" });
    this.engine.signal({ type: phase === "running" ? "pause" : "resume" });
  }

  /** The engine died. @param {string} message @param {boolean} started whether it ever ran */
  died(message, started) {
    // One that never started would not start the next time either.
    const hint = started ? "this is a mistake of ours: copy the report from the log; the page can be used on" : "reload the page; a browser of the last two years is needed";
    this.problem({ file: "the engine", message, hint });
    this.clear();
    if (started) this.engine.restart();
  }
}
