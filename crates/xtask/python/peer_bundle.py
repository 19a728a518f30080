"""Ceres, through pycolmap, on one model: peer_bundle.py MODEL THREADS

All poses, points, focal lengths and distortions move, no loss, defaults otherwise. Ceres prints its own table of
iterations (cost, seconds); the last line is the time that building the problem took.
"""

import sys
import time

import pycolmap

model, threads = pycolmap.Reconstruction(sys.argv[1]), int(sys.argv[2])
options = pycolmap.BundleAdjustmentOptions()
options.print_summary = False
options.ceres.use_gpu = False
solver = options.ceres.solver_options
solver.num_threads = threads
solver.minimizer_progress_to_stdout = True
solver.logging_type = type(solver.logging_type).PER_MINIMIZER_ITERATION
start = time.monotonic()
config = pycolmap.BundleAdjustmentConfig()
for image_id in model.reg_image_ids():
    config.add_image(image_id)
config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
building = time.monotonic() - start
adjuster.solve()
print("building", building, flush=True)
