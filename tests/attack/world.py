"""What calls are made with: small backgrounds of every kind, and values that fit them."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, Delaunay

import adaptsize as ads

PLANE, SURFACE, SOLID, LINE = "triangles", "surface", "tetrahedra", "segments"
GRIDS = ("grid 1-D", "grid 2-D", "grid 3-D")
TREES = ("quadtree", "octree")
MESHES = (PLANE, SURFACE, SOLID, LINE)
KINDS = (*MESHES, *GRIDS, *TREES)


class World(NamedTuple):
    """A background and what belongs to it; a call takes its arguments from one world."""

    kind: str
    background: Any
    other: Any
    """Another background of the same kind."""
    rng: np.random.Generator

    @property
    def dim(self) -> int:
        return self.background.dim

    @property
    def boundary(self) -> Any:
        """A closed line or surface inside the background."""
        return _circle() if self.dim == 2 else _sphere()

    def nodal(self, low: float = 0.05, high: float = 1.0) -> np.ndarray:
        """Return positive values at the nodes."""
        return self.rng.uniform(low, high, self.background.nodal_shape)

    def points(self, n: int | None = None) -> np.ndarray:
        """Return points in and around the background."""
        n = int(self.rng.integers(0, 6)) if n is None else n
        return self.rng.uniform(-0.2, 1.2, (n, self.dim))

    def distance(self, x: np.ndarray) -> np.ndarray:
        """Return the signed distance of a ball in the middle."""
        return np.linalg.norm(np.asarray(x) - 0.5, axis=-1) - 0.3


def make(kind: str, rng: np.random.Generator) -> World:
    """Return a random choice of a few small worlds of a kind (the last decides kernels' types)."""
    first, second = rng.integers(0, 3, 2)
    return World(kind, _background(kind, int(first)), _background(kind, int(second)), rng)


def any_background(rng: np.random.Generator) -> Any:
    """Return a background of any kind."""
    return _background(str(rng.choice(KINDS)), int(rng.integers(0, 3)))


@cache
def _background(kind: str, seed: int) -> Any:
    rng = np.random.default_rng([7, seed])
    if kind in GRIDS:
        dim = GRIDS.index(kind) + 1
        shape = (17, 6, 4)[dim - 1]
        active = None if seed < 2 else rng.random((shape,) * dim) < 0.9
        return ads.CartesianGrid([0.0] * dim, 1.0 / (shape - 1), (shape,) * dim, active=active)
    if kind in TREES:
        dim = 2 + TREES.index(kind)
        return ads.Octree.build(
            [0.0] * dim, [1.0] * dim,
            lambda centres, sizes: rng.random(len(centres)) < 0.5,
            max_level=3 if dim == 2 else 2,
        )  # fmt: skip
    if kind == LINE:
        line = np.linspace(0.0, 1.0, 9)
        points = np.column_stack([line, line**2, 0.0 * line])[:, : 1 + seed]
        return ads.SimplexMesh(points, np.column_stack([np.arange(8), np.arange(1, 9)]))
    if kind == SURFACE:
        return _sphere() if seed == 0 else _cube(seed)
    dim = 2 if kind == PLANE else 3
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * dim), axis=-1).reshape(-1, dim)
    points = np.concatenate([corners, rng.random((12, dim))])
    mesh = ads.SimplexMesh(points, Delaunay(points).simplices)
    if seed == 2:  # a hole and a part of its own
        mesh = ads.SimplexMesh(points, mesh.cells[:: 2 if dim == 2 else 3])
    if seed == 1:
        half = (points[mesh.cells].mean(axis=1)[:, 0] > 0.5).astype(int) + 1
        mesh = ads.SimplexMesh(points, mesh.cells, cell_tags=half)
    return mesh


@cache
def _sphere() -> Any:
    points = np.random.default_rng(8).normal(size=(60, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    return _hull(0.5 + 0.3 * points)


@cache
def _cube(seed: int) -> Any:
    corners = np.stack(np.meshgrid(*[[0.2, 0.8]] * 3), axis=-1).reshape(-1, 3)
    mesh = _hull(corners)
    if seed == 1:
        return mesh
    return ads.SimplexMesh(mesh.points, mesh.cells[2:])  # open


def _hull(points: np.ndarray) -> Any:
    hull = ConvexHull(points)
    cells = hull.simplices.copy()
    a, b, c = points[cells].transpose(1, 0, 2)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    cells[inwards] = cells[inwards][:, [1, 0, 2]]
    return ads.SimplexMesh(points, cells)


@cache
def _circle() -> Any:
    turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    points = 0.5 + 0.3 * np.column_stack([np.cos(turn), np.sin(turn)])
    number = np.arange(24)
    return ads.SimplexMesh(points, np.column_stack([number, (number + 1) % 24]))
