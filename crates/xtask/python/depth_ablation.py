"""Metric depth on 7-Scenes: which stages see it, and what damaged depth maps do. Behind `cargo xtask bench --depth`.

Every row is one reconstruction from the same database; the figures are those of `epipole evaluate`.
"""

import argparse
import json
import os
import shutil
import subprocess
import tempfile

import numpy as np
from PIL import Image

STAGES = ["off", "positioning", "bundle", "both", "paper"]
DAMAGES = {
    "half of the values": "r50",
    "a tenth of the values": "r90",
    "half of the maps": "half",
    "10 % gross errors": "gross",
    "10 % too long in a tenth of the maps": "bias",
}
NO_DEPTH = 0
SATURATED = 65535
# Side of the squares that damage comes in: a keypoint's depth is interpolated, so that a single missing pixel in two would leave
# no depth at all, and a single wrong one is refused as an edge.
SQUARE_PX = 16


def damage(source, target):
    """Copies of the depth maps, damaged in every way, in folders below the target."""
    random = np.random.default_rng(0)
    names = sorted(name for name in os.listdir(source) if name.endswith(".png"))
    order = random.permutation(len(names))
    biased, absent = set(order[: len(names) // 10]), set(order[: len(names) // 2])
    for kind in DAMAGES.values():
        os.makedirs(os.path.join(target, kind))
    for i, name in enumerate(names):
        depth = np.array(Image.open(os.path.join(source, name))).astype(np.int64)
        valid = (depth > NO_DEPTH) & (depth < SATURATED)
        squares = tuple(-(-side // SQUARE_PX) for side in depth.shape)
        spread = lambda a: np.kron(a, np.ones((SQUARE_PX, SQUARE_PX), a.dtype))[: depth.shape[0], : depth.shape[1]]
        hit = lambda share: spread(random.random(squares) < share)
        maps = {
            "r50": np.where(hit(0.5), NO_DEPTH, depth),
            "r90": np.where(hit(0.9), NO_DEPTH, depth),
            "half": None if i in absent else depth,
            "gross": np.where(hit(0.1) & valid, spread(random.integers(400, 8000, squares)), depth),
            "bias": np.where(valid, np.rint(depth * 1.1), depth) if i in biased else depth,
        }
        for kind, values in maps.items():
            if values is not None:
                Image.fromarray(values.astype(np.uint16)).save(os.path.join(target, kind, name))


def reconstruct(arguments, depth, extra, folder):
    """The figures of one run: its own report, and the evaluation with and without the scale aligned."""
    scene = os.path.join(arguments.data, "sevenscenes")
    output = os.path.join(folder, "out")
    shutil.rmtree(output, ignore_errors=True)
    command = [arguments.epipole, "reconstruct", os.path.join(scene, "database.db"), "-o", output]
    command += ["--depth-dir", depth, "--depth-sidecar", arguments.sidecar, "--depth-sigma", str(arguments.sigma), *extra]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    evaluate = [arguments.epipole, "evaluate", os.path.join(output, "0"), os.path.join(scene, "gt/sparse"), "--json"]
    evaluate += ["--cloud", os.path.join(scene, "gt/cloud.ply")]
    read = lambda more: json.loads(subprocess.run(evaluate + more, check=True, capture_output=True).stdout)
    aligned, rigid = read([]), read(["--no-scale"])
    with open(os.path.join(output, "report.json"), encoding="utf-8") as file:
        metric = json.load(file)["components"][0]["metric"]
    return {
        "ate_rigid_m": rigid["ate_rigid"]["rmse"] if metric else None,
        "scale_error": rigid["scale_error"] if metric else None,
        "cloud_rigid_m": rigid["chamfer"]["accuracy"]["median"] if metric else None,
        "ate_aligned_m": aligned["ate"]["rmse"],
        "cloud_aligned_m": aligned["chamfer"]["accuracy"]["median"],
        "auc_10": aligned["auc_all"]["at_10"],
        "with_depth": metric["observations_with_depth_share"] if metric else 0.0,
    }


def row(name, f):
    show = lambda value, form: "–" if value is None else format(value, form)
    cells = [name, show(f["ate_rigid_m"], ".4f"), "–" if f["scale_error"] is None else f"{100 * f['scale_error']:+.1f} %"]
    cells += [show(f["cloud_rigid_m"], ".4f"), f"{f['ate_aligned_m']:.4f}", f"{f['cloud_aligned_m']:.4f}"]
    return "| " + " | ".join(cells + [f"{f['auc_10']:.1f}", f"{100 * f['with_depth']:.0f} %"]) + " |"


def plot(figures, path):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    names = list(figures)
    figure, axes = pyplot.subplots(1, 3, figsize=(12, 4), sharey=True, layout="constrained")
    panels = [
        ("ate_aligned_m", "ATE, similarity (m)", None),
        ("ate_rigid_m", "ATE, rigid (m)", 0.05),
        ("scale_error", "scale error", 0.03),
    ]
    for axis, (key, title, limit) in zip(axes, panels):
        axis.barh(names, [abs(figures[name][key] or 0.0) for name in names], color="#4477aa")
        axis.set_title(title)
        axis.invert_yaxis()
        if limit is not None:
            axis.axvline(limit, color="#cc3311", linestyle="--")
    figure.savefig(path, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--epipole", required=True)
    parser.add_argument("--data", required=True)
    parser.add_argument("--sidecar", required=True)
    parser.add_argument("--sigma", type=float, default=0.01)
    parser.add_argument("--plot")
    arguments = parser.parse_args()
    print("| depth | ATE rigid, m | scale error | cloud, rigid, m | ATE similarity, m | cloud, similarity, m | AUC@10 | observations with depth |")
    print("|---|---|---|---|---|---|---|---|")
    figures = {}
    with tempfile.TemporaryDirectory() as folder:
        maps = os.path.join(arguments.data, "sevenscenes/depth")
        runs = []
        for stages in STAGES:
            extra = ["--depth-weight", "paper"] if stages == "paper" else ["--depth-stages", stages]
            runs.append((stages, maps, extra))
        damage(maps, os.path.join(folder, "damaged"))
        runs += [(name, os.path.join(folder, "damaged", kind), []) for name, kind in DAMAGES.items()]
        for name, depth, extra in runs:
            figures[name] = reconstruct(arguments, depth, extra, folder)
            print(row(name, figures[name]), flush=True)
    if arguments.plot:
        plot(figures, arguments.plot)


if __name__ == "__main__":
    main()
