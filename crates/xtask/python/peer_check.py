"""What must hold of every model that is written: peer_check.py EPIPOLE DATA SCENE…

Three runs (2 threads, 1 thread, 2 threads) give the same bytes; pycolmap loads each model and finds the stored mean
reprojection error; binary to text to binary gives the same bytes. Ends with an error if anything does not hold.
"""

import filecmp
import os
import sys
import tempfile

import pycolmap

import child

# The bound that issue 2 sets.
MAX_ERROR_DIFFERENCE_PX = 1e-6


def same_folder(a, b):
    """Whether two folders hold the same files with the same bytes."""
    names = [sorted(os.path.relpath(os.path.join(d, f), root) for d, _, fs in os.walk(root) for f in fs) for root in (a, b)]
    return names[0] == names[1] and filecmp.cmpfiles(a, b, names[0], shallow=False)[1:] == ([], [])


def check_scene(epipole, database, work):
    outputs = []
    for run, threads in enumerate((2, 1, 2)):
        outputs.append(os.path.join(work, str(run)))
        child.run([epipole, "reconstruct", database, "--output", outputs[-1], "--threads", str(threads), "--json"])
    repeatable = all(same_folder(outputs[0], other) for other in outputs[1:])
    results = []
    for name in sorted(n for n in os.listdir(outputs[0]) if n.isdigit()):
        model = os.path.join(outputs[0], name)
        peer = pycolmap.Reconstruction(model)
        stored = peer.compute_mean_reprojection_error()
        peer.update_point_3d_errors()
        difference = abs(stored - peer.compute_mean_reprojection_error())
        text, binary = os.path.join(work, f"text{name}"), os.path.join(work, f"binary{name}")
        child.run([epipole, "convert", model, text, "--format", "text"])
        child.run([epipole, "convert", text, binary, "--format", "binary"])
        results.append((name, peer.num_reg_images(), stored, difference, same_folder(model, binary)))
    return repeatable, results


def main(epipole, data, scenes):
    failed = 0
    for scene in scenes:
        database = os.path.join(data, scene, "database.db")
        with tempfile.TemporaryDirectory() as work:
            repeatable, models = check_scene(epipole, database, work)
        for name, images, error, difference, round_trip in models:
            good = repeatable and round_trip and difference <= MAX_ERROR_DIFFERENCE_PX
            failed += not good
            print(
                f"{scene:24} model {name}: {images:3} images, {error:.4f} px (pycolmap differs by {difference:.0e}), "
                f"same bytes on 1 and 2 threads: {repeatable}, through text: {round_trip}",
                flush=True,
            )
    if failed:
        sys.exit(f"{failed} models fail")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3:])
