"""Each kernel is compiled once in a typical session: its arguments always have the same types.

Of kernels that come from the cache, those that Python calls are compared; with an empty cache
(NUMBA_CACHE_DIR) also all that they call.
"""

import json
import os
import re
import subprocess
import sys

import numba
import pytest

#: Runs in a fresh process, since other tests call kernels with types of their own.
SESSION = """
import json, sys
import numpy as np
import adaptsize as ads
from adaptsize import background

def limited(mesh):
    corner = np.full(mesh.n_points, np.inf)
    corner[0] = 0.01
    smooth = 1.0 + np.sin(9.0 * mesh.points[:, 0])
    for h0 in (corner, smooth):
        ads.limit_gradient(mesh, h0, 0.3)
        ads.limit_gradient(mesh, h0, np.full(mesh.n_points, 0.3))

for dim in (2, 3):
    grid = ads.CartesianGrid(np.zeros(dim), 0.1, (11,) * dim)
    limited(grid.mesh)
    box = np.full(grid.shape, True)
    box[(slice(4, 7),) * dim] = False
    h0 = 1.0 + np.sin(9.0 * np.linalg.norm(grid.points, axis=1))
    ads.limit_gradient(grid, h0.reshape(grid.shape), 0.3)
    limited(ads.CartesianGrid(np.zeros(dim), 0.1, grid.shape, active=box).mesh)
surface = ads.read("data/bracket.stl")
size = ads.size_function(surface, hmin=3.0, hmax=8.0, tolerance=0.01)
size(surface.points[:5])
ads.signed_distance(ads.CartesianGrid(surface.points.min(axis=0), 20.0, (9, 9, 9)), surface)

found = {}
for name, module in sorted(sys.modules.items()):
    if name.startswith("adaptsize._kernels."):
        for value in vars(module).values():
            if hasattr(value, "signatures") and value.py_func.__module__ == name:
                own = name.rpartition(".")[2] + "." + value.py_func.__name__
                found[own] = [list(map(str, types)) for types in value.signatures]
print(json.dumps(found))
"""

#: Types that may differ, because kernels would be slower otherwise, or longer to compile.
VARIANTS = {
    r"UniTuple\((int64|float64) x \d\)": "axes",  # loops over the dimension are unrolled
    "^none$": "bool",  # code for edges and faces is only compiled where there are any
}

#: Kernels compiled several times, and why.
ALLOWED = {
    "local_updates.distance": "points that are scratch, in solids",
    "local_updates.minimum_on_edge": "the same",
    "local_updates.minimum_on_triangle": "the same",
    "sight.cone_in": "the tables of sectors and of entries",
    "trees.gap2_to_box": "boxes and points",
    "vectors": "a few operations on tuples and on rows of arrays",
}


def without_variants(kind):
    for pattern, same in VARIANTS.items():
        kind = re.sub(pattern, same, kind)
    return kind


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_each_kernel_is_compiled_once():
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", SESSION],
        env=os.environ,
        check=True,
        capture_output=True,
        text=True,
    )
    found = json.loads(done.stdout.splitlines()[-1])
    assert len([name for name, types in found.items() if types]) > 30
    for name, signatures in found.items():
        kinds = {tuple(map(without_variants, types)) for types in signatures}
        allowed = name in ALLOWED or name.partition(".")[0] in ALLOWED
        assert len(kinds) <= 1 or allowed, f"{name} is compiled for {sorted(kinds)}"
