"""Accuracy of a model against another: AUC of the relative-pose error over all pairs, and ATE after alignment."""

import json
import os
import sys

import numpy as np
import pycolmap


def read_poses(folder):
    """{name without folders: (R, t) of cam_from_world}."""
    model = pycolmap.Reconstruction(folder)
    poses = {}
    for image in model.images.values():
        if not image.has_pose:
            continue
        cam_from_world = image.cam_from_world()
        poses[os.path.basename(image.name)] = (cam_from_world.rotation.matrix(), np.array(cam_from_world.translation))
    return poses


def angle_deg(rotations):
    cosine = (np.trace(rotations, axis1=-2, axis2=-1) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def compare(estimate, truth, thresholds=(1, 5)):
    """AUC at the thresholds in percent (missing images count as failures), ATE RMSE in the truth's units."""
    estimated, true = read_poses(estimate), read_poses(truth)
    names = sorted(true)
    found = [name for name in names if name in estimated]
    count = len(found)
    total = len(names) * (len(names) - 1) // 2
    if count < 3:
        return {"images": count, "of": len(names), **{f"auc{t}": 0.0 for t in thresholds}, "ate": float("nan")}
    re, te = (np.array([estimated[n][k] for n in found]) for k in (0, 1))
    rt, tt = (np.array([true[n][k] for n in found]) for k in (0, 1))
    ce, ct = -np.einsum("nji,nj->ni", re, te), -np.einsum("nji,nj->ni", rt, tt)
    i, j = np.triu_indices(count, 1)
    relative = lambda r: np.einsum("nij,nkj->nik", r[j], r[i])
    rotation = angle_deg(np.einsum("nij,nkj->nik", relative(re), relative(rt)))
    direction = lambda r, c: np.einsum("nij,nj->ni", r[j], c[i] - c[j])
    a, b = direction(re, ce), direction(rt, ct)
    norms = np.maximum(np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1), 1e-300)
    translation = np.degrees(np.arccos(np.clip((a * b).sum(1) / norms, -1, 1)))
    error = np.concatenate([np.maximum(rotation, translation), np.full(total - len(i), 180.0)])
    result = {"images": count, "of": len(names)}
    for t in thresholds:
        result[f"auc{t}"] = 100 * float(np.clip(t - error, 0, None).sum()) / (t * len(error))
    result["ate"] = ate(ce, ct)
    return result


def ate(estimated, true):
    """RMSE of camera centres after the least-squares similarity (Umeyama 1991)."""
    ma, mb = estimated.mean(0), true.mean(0)
    a, b = estimated - ma, true - mb
    u, d, vt = np.linalg.svd(b.T @ a / len(a))
    sign = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ sign @ vt
    scale = np.trace(np.diag(d) @ sign) / (a**2).sum(1).mean()
    return float(np.sqrt(((scale * a @ rotation.T - b) ** 2).sum(1).mean()))


if __name__ == "__main__":
    print(json.dumps(compare(sys.argv[1], sys.argv[2])))
