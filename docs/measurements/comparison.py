"""Numbers of docs/comparison.md: gradations of other programs on problems with known sizes.

    python docs/measurements/comparison.py

Needs adaptsize[mmg].
"""

import sys
from pathlib import Path

import mmgpy
import numpy as np

import adaptsize as ads

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "examples"))
from _gallery import jittered_rectangle  # noqa: E402

G = 0.3
LARGEST = 30.0


def main() -> None:
    """Print the errors of the schemes on a square with two sources, and on a plate with a slit."""
    for n_side in (51, 101, 201):
        mesh = jittered_rectangle((-50.0, -50.0), (50.0, 50.0), n_side)
        h0 = np.full(mesh.n_points, LARGEST)
        h = h0.copy()
        for place, size in (((-10.0, 0.0), 1.0), ((10.0, 0.0), 5.0)):
            away = np.linalg.norm(mesh.points - place, axis=1)
            node = int(away.argmin())
            h0[node] = size
            away = np.linalg.norm(mesh.points - mesh.points[node], axis=1)
            h = np.minimum(h, size + G * away)
        print(f"square, {mesh.n_points} nodes")
        report(mesh, h0, h)
    mesh = ads.read(ROOT / "data" / "slit.vtu")
    h0 = np.minimum(mesh.point_data["h0"], LARGEST)
    h = ads.limit_gradient(mesh, h0, G)
    sources = np.flatnonzero(h0 < LARGEST)
    straight = h0.copy()
    for node in sources:
        away = np.linalg.norm(mesh.points - mesh.points[node], axis=1)
        straight = np.minimum(straight, h0[node] + G * away)
    print(f"slit, {mesh.n_points} nodes, sizes {h.min():.3g} to {h.max():.3g}")
    show("straight distances", straight, h)
    report(mesh, h0, h)


def report(mesh: ads.SimplexMesh, h0: np.ndarray, expected: np.ndarray) -> None:
    """Print the errors of our methods and of Mmg."""
    for method in ("exact", "fast-marching", "edge-based"):
        show(method, ads.limit_gradient(mesh, h0, G, method=method), expected)
    show("Mmg, hgrad = exp(g)", by_mmg(mesh, h0), expected)


def show(name: str, h: np.ndarray, expected: np.ndarray) -> None:
    """Print the largest and mean error, absolute and relative."""
    error, share = np.abs(h - expected), np.abs(h / expected - 1.0)
    print(f"  {name:20} {error.max():8.3g} {error.mean():8.3g}   {share.max():6.1%}")


def by_mmg(mesh: ads.SimplexMesh, h0: np.ndarray) -> np.ndarray:
    """Return the sizes that Mmg's gradation makes on an unchanged mesh."""
    other = mmgpy.MmgMesh2D()
    other.set_mesh_size(vertices=mesh.n_points, triangles=mesh.n_cells, edges=0)
    other.set_vertices(np.array(mesh.points), np.zeros(mesh.n_points, np.int64))
    other.set_triangles(np.array(mesh.cells), np.ones(mesh.n_cells, np.int64))
    other["metric"] = h0.reshape(-1, 1)
    extremes = {"hmin": 0.5 * float(h0.min()), "hmax": LARGEST}
    unchanged = {"noinsert": 1, "noswap": 1, "nomove": 1, "nosizreq": 1}
    other.remesh(hgrad=float(np.exp(G)), verbose=-1, **extremes, **unchanged)
    assert np.allclose(other.get_vertices(), mesh.points)
    return np.asarray(other["metric"]).ravel()


if __name__ == "__main__":
    main()
