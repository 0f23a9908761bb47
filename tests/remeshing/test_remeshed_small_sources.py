"""Sources much smaller than the cells of the given mesh, in the new mesh."""

from itertools import combinations

import numpy as np
import pytest

from adaptsize import (
    BallSource,
    BoxSource,
    CartesianGrid,
    CurveSource,
    PointSource,
    SimplexMesh,
    remesh,
    size_function,
)

pytest.importorskip("mmgpy")

SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
CUBE = CartesianGrid([0.0] * 3, 1.0, (2, 2, 2)).mesh
FREE = {"elements_per_radian": 0.0, "elements_across": 0.0, "elements_between": 0.0, "hmax": 0.3}
PLACE = np.array([0.31, 0.62, 0.45])


def mean_edge_around(mesh, points):
    """Return the mean edge of the cell around each point, located by brute force."""
    corners = mesh.points[mesh.cells]
    found = []
    for point in points:
        edges = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
        weights = np.linalg.solve(edges, (point - corners[:, 0])[..., None])[..., 0]
        worst = np.minimum(weights.min(axis=1), 1.0 - weights.sum(axis=1))
        cell = corners[worst.argmax()]
        found.append(np.mean([np.linalg.norm(a - b) for a, b in combinations(cell, 2)]))
    return np.array(found)


@pytest.mark.parametrize(
    ("kind", "mesh", "size"),
    [
        *((kind, SQUARE, 1e-3) for kind in ("point", "curve", "box", "ball", "function")),
        *((kind, CUBE, 0.02) for kind in ("point", "box")),
    ],
)
def test_the_cells_at_a_source_have_its_size_in_one_call(kind, mesh, size):
    place, dim = PLACE[: mesh.dim], mesh.dim
    reach = 5.0 * size
    low, high = place - reach, place + reach
    source = {
        "point": PointSource(place, size),
        "curve": CurveSource([low, high], size),
        "box": BoxSource(low, high, size),
        "ball": BallSource(place, reach, size),
        "function": lambda x: np.maximum(
            size, size + 0.25 * (np.abs(x - place).max(axis=1) - reach)
        ),
    }[kind]
    # A function reaches `remesh` as it is, sources through their size function.
    requested = source if kind == "function" else size_function(mesh, sources=[source], **FREE)
    if kind == "function":
        new = remesh(mesh, lambda x: np.minimum(requested(x), 0.3))
    else:
        new = remesh(mesh, requested)
    t = np.random.default_rng(3).uniform(-1.0, 1.0, (200, 1 if kind == "curve" else dim))
    inside = place + {"point": 0.0, "ball": 0.55}.get(kind, 1.0) * reach * t
    ratio = mean_edge_around(new, inside) / size
    assert 0.7 <= np.median(ratio) <= 1.45
    share = 0.9 if kind in ("box", "ball", "function") else 0.4
    assert ((ratio > np.sqrt(0.5)) & (ratio < np.sqrt(2.0))).mean() >= share
