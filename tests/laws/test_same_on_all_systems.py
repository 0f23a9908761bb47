"""Sizes of twenty problems are those stored, to the last bit where system and versions are equal.

On other systems and processors the standard functions of C (hypot, exp, log, atan2), the linear
algebra of numpy and fused multiply-adds may round differently.  There the sums must agree to 1e-12.

    python tests/laws/test_same_on_all_systems.py

stores the sizes of this version anew.
"""

import hashlib
import json
import platform
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import adaptsize as ads
from adaptsize.limiting import EdgeBased, Exact, FastMarching

STORED = Path(__file__).with_name("stored_sizes.json")
DATA = Path(__file__).parents[2] / "data"
VERSIONS = f"numpy {np.__version__}, numba {numba.__version__}"
THIS = f"{platform.system()} {platform.machine()}, {VERSIONS}"


def jittered(dim, n):
    """Return a mesh of the unit square or cube; random integers are the same on all systems."""
    mesh = ads.CartesianGrid([0] * dim, 1.0 / n, (n + 1,) * dim).mesh
    inner = ((mesh.points > 0.0) & (mesh.points < 1.0)).all(axis=1)
    moves = np.random.default_rng(20261124).integers(-20, 21, (mesh.n_points, dim)) / 128.0
    return ads.SimplexMesh(mesh.points + inner[:, None] * moves / n, mesh.cells)


def bounds(background):
    """Return bounds at every seventh node."""
    h0 = np.full(background.nodal_shape, np.inf)
    flat = h0.reshape(-1)
    flat[::7] = 0.02 + 0.01 * (np.arange(flat[::7].size) % 5)
    return h0


def problems():
    """Yield names and nodal sizes."""
    line = ads.SimplexMesh(np.linspace(0.0, 1.0, 65)[:, None], [[k, k + 1] for k in range(64)])
    active = np.ones((17, 17), bool)
    active[8, :12] = False
    meshes = {
        "line": line,
        "square": jittered(2, 16),
        "cube": jittered(3, 8),
        "slit": ads.read(DATA / "slit.vtu"),
        "block": ads.read(DATA / "block.vtu"),
        "shell": ads.read(DATA / "shell.vtu"),
        "grid": ads.CartesianGrid([0, 0], 0.0625, (17, 17)),
        "grid in space": ads.CartesianGrid([0, 0, 0], 0.125, (9, 9, 9)),
        "grid with a wall": ads.CartesianGrid([0, 0], 0.0625, (17, 17)).with_active(active),
    }
    for name, background in meshes.items():
        yield name, ads.limit_gradient(background, bounds(background), 0.25)
    for name in ("square", "cube", "slit", "grid"):
        for scheme in (FastMarching(), EdgeBased()):
            h = ads.limit_gradient(meshes[name], bounds(meshes[name]), 0.25, method=scheme)
            yield f"{name}, {scheme.name}", h
    nodal = Exact(face_sources=False)
    yield (
        "cube, nodes",
        ads.limit_gradient(meshes["cube"], bounds(meshes["cube"]), 0.25, method=nodal),
    )
    size = ads.size_function(meshes["slit"], elements_per_radian=0, hmin=0.01, hmax=0.5)
    yield "width and separation", size.values
    source = ads.PointSource([0.3, 0.4], 0.01)
    yield "source", ads.size_function(meshes["square"], sources=source, hmax=0.2).values


def summaries():
    """Return the digest of the bits and the sum of the sizes, by problem."""
    found = {}
    for name, h in problems():
        values = np.ascontiguousarray(h, dtype="<f8").ravel()
        digest = hashlib.sha256(values.tobytes()).hexdigest()[:16]
        found[name] = [digest, float(np.sum(values, where=np.isfinite(values)))]
    return found


def test_sizes_of_twenty_problems_are_those_stored():
    stored, found = json.loads(STORED.read_text()), summaries()
    assert len(found) == 20
    assert found.keys() == stored["sizes"].keys()
    for name, (_, total) in stored["sizes"].items():
        assert found[name][1] == pytest.approx(total, rel=1e-12), name
    differ = [name for name, (digest, _) in stored["sizes"].items() if found[name][0] != digest]
    if stored["system"] == THIS:
        assert differ == []
    elif differ:
        print(f"{THIS}: other last bits than {stored['system']} in {', '.join(differ)}")


if __name__ == "__main__":
    text = json.dumps({"system": THIS, "sizes": summaries()}, indent=1)
    STORED.write_text(text + "\n")
    sys.exit(0)
