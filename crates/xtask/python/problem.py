"""One bundle adjustment problem away from its optimum: a model with everything that moves perturbed."""

import json
import sys

import numpy as np
import pycolmap


def perturbed(source_folder, target_folder, seed=0):
    """Writes the perturbed model; returns its numbers of images, points and observations.

    Rotations move by 0.2°, centres and points by 0.2 % of the cameras' extent, focal lengths by 0.5 % (standard
    deviations). Points that a perturbed camera would see close to or behind itself are left out: the programs treat
    them differently, and their costs could not be compared.
    """
    rng = np.random.default_rng(seed)
    model = pycolmap.Reconstruction(source_folder)
    centers = np.array([model.images[i].projection_center() for i in sorted(model.reg_image_ids())])
    extent = float(np.linalg.norm(centers.max(0) - centers.min(0)))
    for _, camera in sorted(model.cameras.items()):
        for index in camera.focal_length_idxs():
            camera.params[index] *= 1 + 0.005 * rng.standard_normal()
    for image_id in sorted(model.reg_image_ids()):
        image = model.images[image_id]
        turn = pycolmap.Rotation3d(np.radians(0.2) * rng.standard_normal(3))
        rotation = turn * image.cam_from_world().rotation
        center = image.projection_center() + 0.002 * extent * rng.standard_normal(3)
        image.frame.set_cam_from_world(image.camera_id, pycolmap.Rigid3d(rotation, -(rotation.matrix() @ center)))
    for point_id, point in sorted(model.points3D.items()):
        point.xyz = point.xyz + 0.002 * extent * rng.standard_normal(3)
        depths = [(model.images[e.image_id].cam_from_world() * point.xyz)[2] for e in point.track.elements]
        if min(depths) < 0.01 * extent:
            model.delete_point3D(point_id)
    model.write(target_folder)
    return model.num_reg_images(), model.num_points3D(), model.compute_num_observations()


if __name__ == "__main__":
    print(json.dumps(perturbed(sys.argv[1], sys.argv[2])))
