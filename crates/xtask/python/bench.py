"""Epipole against pycolmap on the same inputs, in turn, on this machine: the driver behind `cargo xtask bench`.

Every run is a process of its own, so that its peak memory is its own. Both programs run once unmeasured on a small
scene first, which warms the file cache and the libraries.
"""

import argparse
import json
import os
import shutil
import statistics
import sys
import tempfile

import child

# name: (truth below the scene's folder, intrinsics held)
SCENES = {
    "strecha_castle-P19": ("gt/sparse", False),
    "strecha_Herz-Jesus-P25": ("gt/sparse", False),
    "strecha_Herz-Jesus-P8": ("gt/sparse", False),
    "lund_door": ("gt/sparse", False),
    "middlebury_templering19": ("gt/sparse", True),
    "colmap2017_db": ("gt/sparse", False),
    "kermit": ("gt/sparse", False),
    "sceaux_castle": ("colmap_global", False),
    "sevenscenes": ("gt/sparse", False),
    "bonsai292": ("colmap_global", False),
}


def mib(size_bytes):
    return f"{size_bytes / 2**20:.0f}"


def local_copy(source, folder):
    """A private copy of a database with its sidecars: pycolmap migrates what it opens."""
    target = os.path.join(folder, "database.db")
    for ending in ("", "-wal", "-shm"):
        if os.path.exists(source + ending):
            shutil.copyfile(source + ending, target + ending)
    os.chmod(target, 0o644)
    return target


def run_peer(database, output, threads, fixed):
    seconds = []

    def line(text, _):
        if text.startswith("seconds "):
            seconds.append(float(text.split()[1]))

    _, peak = child.python("peer_mapping.py", database, output, threads, "fixed" if fixed else "free", on_line=line)
    return seconds[0], peak, os.path.join(output, "best")


def run_ours(epipole, database, output, threads, fixed):
    command = [epipole, "reconstruct", database, "--output", output, "--threads", str(threads), "--seed", "0", "--json"]
    wall, peak = child.run(command + (["--intrinsics", "fixed"] if fixed else []))
    return wall, peak, os.path.join(output, "0")


def bench_scene(arguments, name, work):
    truth, fixed = SCENES[name]
    folder = os.path.join(arguments.data, name)
    database = local_copy(os.path.join(folder, "database.db"), work)
    times, peaks, models = {"peer": [], "ours": []}, {"peer": 0, "ours": 0}, {}
    for turn in range(arguments.repeats):
        for who in ("peer", "ours"):
            output = os.path.join(work, f"{who}{turn}")
            if who == "peer":
                seconds, peak, model = run_peer(database, output, arguments.threads, fixed)
            else:
                seconds, peak, model = run_ours(arguments.epipole, database, output, arguments.threads, fixed)
            times[who].append(seconds)
            peaks[who] = max(peaks[who], peak)
            models[who] = model
    medians = {who: statistics.median(values) for who, values in times.items()}
    accuracy = {who: child.python_json("poses.py", models[who], os.path.join(folder, truth)) for who in models}
    row = {
        "scene": name,
        "repeats": arguments.repeats,
        "seconds": medians,
        "ratio": medians["peer"] / medians["ours"],
        "peak_bytes": peaks,
        "accuracy": accuracy,
    }
    peer, ours = accuracy["peer"], accuracy["ours"]
    print(
        f"{name:24} {medians['peer']:9.2f} s {medians['ours']:8.2f} s  x{row['ratio']:6.1f}   "
        f"{mib(peaks['peer']):>6} {mib(peaks['ours']):>6} MiB   "
        f"{peer['images']:>3}/{ours['images']:>3} images   AUC@1 {peer['auc1']:5.1f}/{ours['auc1']:5.1f}   "
        f"AUC@5 {peer['auc5']:5.1f}/{ours['auc5']:5.1f}   ATE {peer['ate']:.4f}/{ours['ate']:.4f}",
        flush=True,
    )
    return row


def bench_bundle(arguments, work):
    """Time until the cost is within 0.1 % of the lower of the two programs' final costs, from the same start."""
    database = local_copy(os.path.join(arguments.data, arguments.bundle_scene, "database.db"), work)
    _, _, start = run_ours(arguments.epipole, database, os.path.join(work, "start"), arguments.threads, False)
    model = os.path.join(work, "perturbed")
    os.makedirs(model)
    sizes = child.python_json("problem.py", start, model)
    print(f"bundle adjustment of {arguments.bundle_scene}: {sizes[0]} images, {sizes[1]} points, {sizes[2]} observations")
    traces, peaks = {}, {}
    peer, offset = [], [0.0]

    def peer_line(text, _):
        fields = text.split()
        if text.startswith("building "):
            offset[0] = float(fields[1])
        elif len(fields) == 10 and fields[0].isdigit():
            peer.append((float(fields[1]), float(fields[9])))

    _, peaks["peer"] = child.python("peer_bundle.py", model, arguments.threads, on_line=peer_line)
    # Ceres counts its preprocessing in the total; only the building of the problem comes on top.
    traces["peer"] = [(cost, seconds + offset[0]) for cost, seconds in peer]
    ours = []

    def our_line(text, seconds):
        event = json.loads(text)
        cost = event.get("cost", event.get("final_cost"))
        if cost is not None:
            ours.append((float(cost), seconds))

    command = [arguments.epipole, "bundle", model, "--threads", str(arguments.threads), "--json"]
    _, peaks["ours"] = child.run(command, our_line)
    traces["ours"] = ours
    lowest = min(cost for trace in traces.values() for cost, _ in trace)
    reached = {}
    for who, trace in traces.items():
        final = min(cost for cost, _ in trace)
        at = [seconds for cost, seconds in trace if cost <= 1.001 * lowest]
        reached[who] = at[0] if at else float("inf")
        print(
            f"  {'pycolmap' if who == 'peer' else 'epipole':9} final cost {final:.6e}, "
            f"within 0.1 % of {lowest:.6e} after {reached[who]:.2f} s, peak {mib(peaks[who])} MiB"
        )
    print(f"  ratio x{reached['peer'] / reached['ours']:.1f}")
    return {"bundle": arguments.bundle_scene, "sizes": sizes, "seconds": reached, "peak_bytes": peaks, "lowest": lowest}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--epipole", required=True)
    parser.add_argument("--data", required=True)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--scenes", nargs="+", required=True)
    parser.add_argument("--bundle", action="store_true")
    parser.add_argument("--bundle-scene", default="bonsai292")
    parser.add_argument("--json")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.scenes if name not in SCENES]
    if unknown:
        sys.exit(f"unknown scene {unknown[0]}; known: {', '.join(SCENES)}")
    rows = []
    with tempfile.TemporaryDirectory() as work:
        smallest = os.path.join(arguments.data, "kermit", "database.db")
        database = local_copy(smallest, work)
        run_peer(database, os.path.join(work, "warm_peer"), arguments.threads, False)
        run_ours(arguments.epipole, database, os.path.join(work, "warm_ours"), arguments.threads, False)
    print(f"pycolmap / epipole, {arguments.threads} threads each, medians of {arguments.repeats}, in turn")
    for name in arguments.scenes:
        with tempfile.TemporaryDirectory() as work:
            rows.append(bench_scene(arguments, name, work))
    if arguments.bundle:
        with tempfile.TemporaryDirectory() as work:
            rows.append(bench_bundle(arguments, work))
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(rows, file, indent=1)


if __name__ == "__main__":
    main()
