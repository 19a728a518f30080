"""pycolmap's rotation averaging on the Ellis Island edges: peer_rotations.py FOLDER

Prints the mean and median rotation error, degrees, after aligning with the reference.
"""

import os
import sys
import time

import numpy as np
import pycolmap

from poses import angle_deg


def read_edges(path):
    rows = np.loadtxt(path, comments="#")
    return rows[:, :2].astype(int), rows[:, 2:].reshape(-1, 3, 3)


def aligned_errors(estimated, true):
    """Angles of `estimated · A` to `true` for the A of least chordal distance, as in our own test."""
    u, _, vt = np.linalg.svd(np.einsum("nji,njk->ik", estimated, true))
    alignment = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return angle_deg(np.einsum("nij,jk,nlk->nil", estimated, alignment, true))


def main(folder):
    pycolmap.logging.minloglevel = 2
    pairs, rotations = read_edges(os.path.join(folder, "edges.txt"))
    truth = np.loadtxt(os.path.join(folder, "gt.txt"), comments="#")
    known, true = truth[:, 0].astype(int), truth[:, 1:].reshape(-1, 3, 3)
    model, graph = pycolmap.Reconstruction(), pycolmap.PoseGraph()
    for i in range(int(pairs.max()) + 1):
        camera = pycolmap.Camera(camera_id=i + 1, model="SIMPLE_PINHOLE", width=2, height=2, params=[1, 1, 1])
        model.add_camera_with_trivial_rig(camera)
        model.add_image_with_trivial_frame(pycolmap.Image(name=str(i), camera_id=i + 1, image_id=i + 1))
    for (i, j), rotation in zip(pairs, rotations):
        edge = pycolmap.PoseGraphEdge()
        edge.cam2_from_cam1 = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), np.zeros(3))
        edge.num_matches = 100
        graph.add_edge(int(i) + 1, int(j) + 1, edge)
    options = pycolmap.RotationEstimatorOptions()
    options.random_seed = 0
    start = time.monotonic()
    if not pycolmap.run_rotation_averaging(options, graph, model, []):
        raise SystemExit("pycolmap's rotation averaging failed")
    seconds = time.monotonic() - start
    found = [k for k, i in enumerate(known) if model.images[int(i) + 1].has_pose]
    estimated = np.array([model.images[int(known[k]) + 1].cam_from_world().rotation.matrix() for k in found])
    errors = aligned_errors(estimated, true[found])
    print(f"pycolmap: mean {errors.mean():.3f} deg, median {np.median(errors):.3f} deg over {len(errors)} of "
          f"{len(known)} cameras, {seconds:.2f} s")


if __name__ == "__main__":
    main(sys.argv[1])
