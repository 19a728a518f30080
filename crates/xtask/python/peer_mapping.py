"""pycolmap's global mapper on one database, in a process of its own: peer_mapping.py DATABASE OUTPUT THREADS FIXED

Prints the seconds that `global_mapping` itself took, without Python's start, and writes the largest model.
"""

import os
import sys
import time

import pycolmap

database, output, threads, fixed = sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4] == "fixed"
pycolmap.logging.minloglevel = 2
options = pycolmap.GlobalPipelineOptions()
options.num_threads = threads
options.random_seed = 0
options.mapper.num_threads = threads
options.mapper.random_seed = 0
adjustment = options.mapper.bundle_adjustment
adjustment.ceres.use_gpu = False
options.mapper.global_positioning.use_gpu = False
if fixed:
    adjustment.refine_focal_length = False
    adjustment.refine_principal_point = False
    adjustment.refine_extra_params = False
os.makedirs(output, exist_ok=True)
start = time.monotonic()
models = pycolmap.global_mapping(database, os.path.dirname(database), output, options)
print("seconds", time.monotonic() - start)
if not models:
    sys.exit("pycolmap made no model")
largest = max(models.values(), key=lambda model: model.num_reg_images())
best = os.path.join(output, "best")
os.makedirs(best, exist_ok=True)
largest.write(best)
