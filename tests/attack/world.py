"""Small backgrounds of every kind, and arguments that a call on them may accept."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from meshes import random_sphere
from scipy.spatial import Delaunay
from shapes import moved
from solids import box, circle, outline

import adaptsize as ads

from .subjects import Subject

PLANE, SURFACE, SOLID, LINE = "triangles", "surface", "tetrahedra", "segments"
GRIDS = ("grid 1-D", "grid 2-D", "grid 3-D")
TREES = ("quadtree", "octree")
MESHES = (PLANE, SURFACE, SOLID, LINE)
KINDS = (*MESHES, *GRIDS, *TREES)
_CIRCLE = moved(outline(circle(24)), 0.5, 0.3)


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
    def mesh(self) -> Any:
        """The background, or its simplices."""
        return self.background if self.kind in MESHES else getattr(self.background, "mesh", None)

    @property
    def n_cells(self) -> int:
        return getattr(self.background, "n_cells", 1)

    @property
    def boundary(self) -> Any:
        """A closed line or surface inside the background."""
        return _background(SURFACE, 0) if self.dim == 3 else _CIRCLE

    @property
    def size(self) -> ads.SizeFunction:
        return ads.SizeFunction(self.background, self.nodal())

    def nodal(self) -> np.ndarray:
        """Return positive values at the nodes."""
        return self.rng.uniform(0.05, 1.0, self.background.nodal_shape)

    @property
    def matrices(self) -> np.ndarray:
        """The unit matrix for each node."""
        return np.broadcast_to(np.eye(self.dim), (self.nodal().size, self.dim, self.dim))

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
        return ads.Octree.build([0.0] * dim, [1.0] * dim, max_level=5 - dim,
                                needs_refinement=lambda x, s: rng.random(len(x)) < 0.5)  # fmt: skip
    if kind == LINE:
        line = np.linspace(0.0, 1.0, 9)
        points = np.column_stack([line, line**2, 0.0 * line])[:, : 1 + seed]
        return ads.SimplexMesh(points, np.column_stack([np.arange(8), np.arange(1, 9)]))
    if kind == SURFACE:
        if seed == 0:
            return moved(random_sphere(60, 8), 0.5, 0.3)
        cube = moved(box(0.6, 0.6, 0.6), 0.2)
        return ads.SimplexMesh(cube.points, cube.cells[2 * (seed - 1) :])  # the last is open
    dim = 2 if kind == PLANE else 3
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * dim), axis=-1).reshape(-1, dim)
    points = np.concatenate([corners, rng.random((12, dim))])
    cells = Delaunay(points).simplices
    half = points[cells].mean(axis=1)[:, 0] > 0.5
    # The last has a hole and a part of its own.
    return ads.SimplexMesh(points, cells[:: dim if seed == 2 else 1],
                           cell_tags=half + 1 if seed == 1 else None)  # fmt: skip


_KINDS_OF = {
    "SimplexMesh": MESHES, "PartitionedMesh": MESHES, "CartesianGrid": GRIDS, "Octree": TREES,
    "SignedDistance": (PLANE, SOLID), "FieldTransfer": (PLANE, SOLID),
}  # fmt: skip
"""Kinds of background for the methods of a class."""
_KINDS_BY_NAME = {"surface": SURFACE, "line": LINE, "boundary": SURFACE, "grid": GRIDS[1]}


def kind_for(subject: Subject, rng: np.random.Generator) -> str:
    """Return a kind of background on which a call may succeed."""
    if "SimplexMesh" in subject.annotations.get("mesh", ""):
        return str(rng.choice([PLANE, SOLID, PLANE, SOLID, SURFACE, LINE]))
    for name, kind in _KINDS_BY_NAME.items():
        if name in subject.parameters and "background" not in subject.parameters:
            return kind
    return str(rng.choice(_KINDS_OF.get(subject.owner, KINDS)))


_OWNERS: dict[str, Callable[[World], Any]] = {
    "SizeFunction": lambda w: w.size,
    "FieldTransfer": lambda w: ads.FieldTransfer(w.background, w.other),
    "SignedDistance": lambda w: ads.geometry.SignedDistance(w.boundary),
    "Metric": lambda w: ads.Metric.isotropic(w.nodal().ravel(), w.dim),
    "MetricFunction": lambda w: ads.metrics.MetricFunction(
        w.mesh or w.other, ads.Metric.isotropic(np.full(w.mesh.n_points, 0.1), w.dim)
    ),
    "PartitionedMesh": lambda w: ads.distributed.PartitionedMesh.from_serial(w.mesh),
}


def owner_of(subject: Subject, world: World) -> Any:
    """Return an instance of the class of a method."""
    return _OWNERS.get(subject.owner, lambda w: w.background)(world)


_BY_NAME: dict[str, Callable[[World], Any]] = {
    "cells": lambda w: w.background.cells if w.kind in MESHES else np.array([[0, 1, 2]]),
    "points": lambda w: w.background.points if w.kind in MESHES else w.points(),
    "fixed_points": lambda w: w.points(1),
    "origin": lambda w: np.zeros(w.dim),
    "lower": lambda w: np.zeros(w.dim),
    "upper": lambda w: np.ones(w.dim),
    "centre": lambda w: np.full(w.dim, 0.5),
    "spacing": lambda w: 0.25,
    "shape": lambda w: (5,) * w.dim,
    "root_shape": lambda w: (2,) * w.dim,
    "levels": lambda w: np.ones((2,) * w.dim, int),
    "required_facets": lambda w: w.background.boundary().cells[:2],
    "curve": lambda w: w.boundary,
    "image": lambda w: np.pad(np.ones((4, 4, 4)[: max(w.dim, 2)]), 2),
    "tagged_facets": lambda w: w.background.cells[:1, :-1],
    "facet_tags": lambda w: [1],
    "cell_tags": lambda w: np.ones(w.n_cells, int),
    "active": lambda w: np.ones(w.background.nodal_shape, bool),
    "size": lambda w: 0.2,
    "phi": lambda w: w.distance(np.reshape(w.background.points, (-1, w.dim))).reshape(
        w.background.nodal_shape
    ),
    "directions": lambda w: w.matrices,
    "matrices": lambda w: w.matrices,
    "hessian": lambda w: w.matrices,
    "normals": lambda w: w.matrices[:, 0],
    "global_ids": lambda w: np.arange(w.nodal().size),
    "owner": lambda w: np.zeros(w.nodal().size, int),
    "indicator": lambda w: w.rng.random(w.n_cells),
}

_NUMBERS: dict[str, tuple[float | int, ...]] = {
    "order": (1, 2), "max_level": (2, 3), "max_iter": (1, 20), "timeout": (60.0,),
    "max_elements": (300.0, 3000.0), "elements": (50.0,), "nodes": (30.0,), "width": (200,),
    "smoothing": (0, 1, 2), "hmin": (0.1,), "hmax": (0.5, 2.0), "label": (1,), "angle": (40.0,),
    "boundary_tolerance": (1e-3,), "tolerance": (1e-3, 0.1), "seed": (1,),
}  # fmt: skip


def fitting(name: str, annotation: str, world: World) -> Any:
    """Return a value for a parameter that a call may accept, or `NotImplemented`."""
    # Unions are split at the bars outside of brackets.
    parts = [part.strip() for part in re.split(r"\|(?![^\[]*\])", annotation)]
    known = [(part, maker) for part in parts for key, maker in _MAKERS if part.startswith(key)]
    known = [(part, maker) for part, maker in known if part != "None"] or known
    if not known:
        return NotImplemented
    part, maker = known[int(world.rng.integers(0, len(known)))]
    return maker(name, part, world)


def _array(name: str, part: str, world: World) -> Any:
    if name in _BY_NAME:
        try:
            return _BY_NAME[name](world)
        except (AttributeError, ValueError):  # of another kind of background
            return world.nodal()
    if "values" in name and world.kind in MESHES and world.rng.random() < 0.3:
        return world.rng.normal(size=world.n_cells)
    return world.nodal()


def _number(name: str, part: str, world: World) -> Any:
    values = _NUMBERS.get(name, (0.3, 1.0, 3.0) if part.startswith("float") else (1, 2))
    return values[int(world.rng.integers(0, len(values)))]


def _literal(name: str, part: str, world: World) -> Any:
    words = re.findall(r"['\"]([^'\"]*)['\"]", part)
    return str(world.rng.choice(words)) if words else None


def _limit(name: str, part: str, world: World) -> Any:
    kinds = (0.3, lambda h: 0.2 + 0.1 * np.tanh(h), world.nodal(), (world.nodal(), lambda h: h / h))
    return kinds[int(world.rng.integers(0, len(kinds)))]


def _mesh(name: str, part: str, world: World) -> Any:
    if name in ("boundary", "surface", "curve"):
        return world.boundary
    return world.other if name == "new" else world.background


def _path(name: str, part: str, world: World) -> Any:
    suffixes = [".vtu", ".stl", ".msh", ".mesh", ".vti", ".png", ".obj", ".npy"]
    path = Path("file" + str(world.rng.choice(suffixes)))
    if not path.exists():
        path.write_bytes(world.rng.bytes(200))
    return path


def _all(keys: str, maker: Callable[[str, str, World], Any]) -> list[tuple[str, Any]]:
    return [(key, maker) for key in keys.split()]


_MAKERS: list[tuple[str, Callable[[str, str, World], Any]]] = [
    *_all("npt.ArrayLike FloatArray IntArray npt.NDArray BoundLike Size", _array),
    *_all("float int", _number),
    *_all("SimplexMesh CartesianGrid Octree AnyBackground LocatableBackground _Outline", _mesh),
    *_all("_Boundary DistanceFunction Implicit PointFunction Field Callable",
          lambda name, part, w: w.distance),
    *_all("None MedialAxis LimitingInfo ProgressCallback", lambda name, part, w: None),
    *_all("str Method Target", lambda name, part, w: "auto"),
    *_all("Mapping Fields", lambda name, part, w: {
        "u": w.rng.random(w.n_cells) if "cell" in name else w.nodal()
    }),
    *_all("SizeFunction SizeLike", lambda name, part, w: w.size),
    ("Literal", _literal),
    ("GradientLimit", _limit),
    ("Domain", lambda name, part, w: (w.background, w.distance)[int(w.rng.integers(0, 2))]),
    ("tuple", lambda name, part, w: (
        (np.zeros(w.dim), np.ones(w.dim)) if name == "box" else (w.points(3), np.full(3, 0.2))
    )),
    ("os.PathLike", _path),
    ("bool", lambda name, part, w: bool(w.rng.random() < 0.5)),
    ("Metric", lambda name, part, w: _OWNERS["Metric"](w)),
    ("PartitionedMesh", lambda name, part, w: _OWNERS["PartitionedMesh"](w)),
    ("NeedsRefinement", lambda name, part, w: lambda x, s: np.zeros(len(x), bool)),
    ("Source", lambda name, part, w: ads.PointSource(w.points(2), 0.1)),
    ("Iterable[Source", lambda name, part, w: [ads.BallSource(np.full(w.dim, 0.5), 0.2, 0.1)]),
    ("Image", lambda name, part, w: ads.background.Image(_BY_NAME["image"](w))),
    ("Sequence", lambda name, part, w: _BY_NAME.get(name, lambda w: [1])(w)),
    ("Any", lambda name, part, w: ()),
]  # fmt: skip
"""What makes a value, by the beginning of an annotation."""
