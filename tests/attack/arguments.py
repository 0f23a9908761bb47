"""Arguments that fit a parameter, by its annotation and its name."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import adaptsize as ads

from .nonsense import nonsense
from .subjects import Subject
from .world import GRIDS, LINE, MESHES, PLANE, SOLID, SURFACE, TREES, World

_SMALL_ARRAYS: dict[str, Callable[[World], Any]] = {
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
    "cell_tags": lambda w: np.ones(_n_cells(w), int),
    "active": lambda w: np.ones(w.background.nodal_shape, bool),
    "size": lambda w: 0.2,
    "phi": lambda w: w.distance(np.reshape(w.background.points, (-1, w.dim))).reshape(
        w.background.nodal_shape
    ),
    "initial": lambda w: w.nodal(),
    "directions": lambda w: np.broadcast_to(np.eye(w.dim), (w.nodal().size, w.dim, w.dim)),
    "matrices": lambda w: np.broadcast_to(np.eye(w.dim), (w.nodal().size, w.dim, w.dim)),
    "hessian": lambda w: np.broadcast_to(np.eye(w.dim), (w.nodal().size, w.dim, w.dim)),
    "normals": lambda w: np.broadcast_to(np.eye(w.dim)[0], (w.nodal().size, w.dim)),
    "global_ids": lambda w: np.arange(w.nodal().size),
    "owner": lambda w: np.zeros(w.nodal().size, int),
    "indicator": lambda w: w.rng.random(_n_cells(w)),
}

_NUMBERS: dict[str, tuple[float | int, ...]] = {
    "order": (1, 2),
    "max_level": (2, 3),
    "max_iter": (1, 20),
    "timeout": (60.0,),
    "max_elements": (300.0, 3000.0),
    "target_elements": (50.0,),
    "width": (200,),
    "smoothing": (0, 1, 2),
    "hmin": (0.1,),
    "hmax": (0.5, 2.0),
    "label": (1,),
    "angle": (40.0,),
    "boundary_tolerance": (1e-3,),
    "tolerance": (1e-3, 0.1),
    "seed": (1,),
}

_KINDS_BY_NAME = {"surface": SURFACE, "line": LINE, "boundary": SURFACE, "grid": GRIDS[1]}


def kind_for(subject: Subject, rng: np.random.Generator) -> str:
    """Return a kind of background on which a call may succeed."""
    texts = {name: str(p.annotation) for name, p in subject.parameters.items()}
    if "mesh" in texts and "SimplexMesh" in texts["mesh"]:
        return str(rng.choice([PLANE, SOLID, PLANE, SOLID, SURFACE, LINE]))
    for name, kind in _KINDS_BY_NAME.items():
        if name in texts and "background" not in texts:
            return kind
    if subject.owner == "PartitionedMesh" or "PartitionedMesh" in texts.get("mesh", ""):
        return str(rng.choice(MESHES))
    everything = [*MESHES, *GRIDS, *TREES]
    if subject.owner == "SimplexMesh":
        everything = list(MESHES)
    if subject.owner == "SignedDistance":
        everything = [PLANE, SOLID]
    if subject.owner == "FieldTransfer":
        everything = [PLANE, SOLID]
    if subject.owner == "CartesianGrid":
        everything = list(GRIDS)
    if subject.owner == "Octree":
        everything = list(TREES)
    return str(rng.choice(everything))


def owner_of(subject: Subject, world: World) -> Any:
    """Return an instance of the class of a method."""
    if subject.owner == "SizeFunction":
        return ads.SizeFunction(world.background, world.nodal())
    if subject.owner == "FieldTransfer":
        return ads.FieldTransfer(world.background, world.other)
    if subject.owner == "SignedDistance":
        return ads.geometry.SignedDistance(world.boundary)
    if subject.owner == "Metric":
        return _metric("", "", world)
    if subject.owner == "MetricFunction":
        given = world.background
        mesh = given if isinstance(given, ads.SimplexMesh) else given.mesh
        metric = ads.isotropic_metric(np.full(mesh.n_points, 0.1), mesh.dim)
        return ads.metrics.MetricFunction(mesh, metric)
    if subject.owner == "PartitionedMesh":
        return ads.distributed.PartitionedMesh.from_serial(world.background)
    if subject.owner in ("SimplexMesh", "CartesianGrid", "Octree"):
        return world.background
    raise LookupError(f"no instance of {subject.owner}")


def fitting(name: str, annotation: str, world: World) -> Any:
    """Return a value for a parameter that a call may accept."""
    rng = world.rng
    choices = [part.strip() for part in _split(annotation.strip("'\""))]
    known = [(part, _MAKERS[key]) for part in choices for key in _MAKERS if part.startswith(key)]
    known = [(part, maker) for part, maker in known if part != "None"] or known
    if not known:
        return nonsense(rng)
    part, maker = known[int(rng.integers(0, len(known)))]
    return maker(name, part, world)


def _split(annotation: str) -> list[str]:
    """Split a union at the bars outside of brackets."""
    parts, depth = [""], 0
    for letter in annotation:
        depth += (letter in "[(") - (letter in "])")
        if letter == "|" and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _array(name: str, part: str, world: World) -> Any:
    if name in _SMALL_ARRAYS:
        try:
            return _SMALL_ARRAYS[name](world)
        except (AttributeError, ValueError):  # of another kind of background
            return world.nodal()
    if "values" in name and world.kind in MESHES and world.rng.random() < 0.3:
        return world.rng.normal(size=(_n_cells(world)))
    return world.nodal()


def _number(name: str, part: str, world: World) -> Any:
    values = _NUMBERS.get(name, (0.3, 1.0, 3.0) if part.startswith("float") else (1, 2))
    return values[int(world.rng.integers(0, len(values)))]


def _literal(name: str, part: str, world: World) -> Any:
    words = re.findall(r"'([^']*)'|\"([^\"]*)\"", part)
    return str(world.rng.choice([a or b for a, b in words])) if words else None


def _limit(name: str, part: str, world: World) -> Any:
    kinds = (0.3, lambda h: 0.2 + 0.1 * np.tanh(h), world.nodal(), (world.nodal(), lambda h: h / h))
    return kinds[int(world.rng.integers(0, len(kinds)))]


def _mesh(name: str, part: str, world: World) -> Any:
    if name in ("boundary", "surface", "curve"):
        return world.boundary
    if name == "new":
        return world.other
    return world.background


def _path(name: str, part: str, world: World) -> Any:
    suffix = str(
        world.rng.choice([".vtu", ".stl", ".msh", ".mesh", ".vti", ".png", ".obj", ".npy"])
    )
    path = Path("file" + suffix)
    if not path.exists():
        path.write_bytes(world.rng.bytes(200))
    return path


def _fields(name: str, part: str, world: World) -> Any:
    values = world.rng.random(_n_cells(world)) if "cell" in name else world.nodal()
    return {"u": values}


def _size(name: str, part: str, world: World) -> Any:
    return ads.SizeFunction(world.background, world.nodal())


def _metric(name: str, part: str, world: World) -> Any:
    return ads.metrics.isotropic_metric(world.nodal().ravel(), world.dim)


def _partitioned(name: str, part: str, world: World) -> Any:
    whole = world.background
    if world.kind not in MESHES:
        whole = getattr(whole, "mesh", whole)
    return ads.distributed.PartitionedMesh.from_serial(whole)


def _pair(name: str, part: str, world: World) -> Any:
    if name == "box":
        return np.zeros(world.dim), np.ones(world.dim)
    return world.points(3), np.full(3, 0.2)


def _domain(name: str, part: str, world: World) -> Any:
    return (world.background, world.distance)[int(world.rng.integers(0, 2))]


def _n_cells(world: World) -> int:
    return getattr(world.background, "n_cells", 1)


_MAKERS: dict[str, Callable[[str, str, World], Any]] = {
    "None": lambda name, part, world: None,
    "npt.ArrayLike": _array,
    "FloatArray": _array,
    "IntArray": _array,
    "npt.NDArray": _array,
    "BoundLike": _array,
    "float": _number,
    "int": _number,
    "bool": lambda name, part, world: bool(world.rng.random() < 0.5),
    "str": lambda name, part, world: "auto",
    "Literal": _literal,
    "Method": lambda name, part, world: "auto",
    "Target": lambda name, part, world: "auto",
    "GradientLimit": _limit,
    "Metric": _metric,
    "PartitionedMesh": _partitioned,
    "SimplexMesh": _mesh,
    "CartesianGrid": _mesh,
    "Octree": _mesh,
    "AnyBackground": _mesh,
    "LocatableBackground": _mesh,
    "Domain": _domain,
    "_Outline": _mesh,
    "_Boundary": lambda name, part, world: world.distance,
    "DistanceFunction": lambda name, part, world: world.distance,
    "Implicit": lambda name, part, world: world.distance,
    "PointFunction": lambda name, part, world: world.distance,
    "Field": lambda name, part, world: world.distance,
    "Callable": lambda name, part, world: world.distance,
    "NeedsRefinement": lambda name, part, world: lambda x, s: np.zeros(len(x), bool),
    "Source": lambda name, part, world: ads.PointSource(world.points(2), 0.1),
    "Iterable[Source": lambda name, part, world: [
        ads.BallSource(np.full(world.dim, 0.5), 0.2, 0.1)
    ],
    "SizeFunction": _size,
    "SizeLike": _size,
    "Size": _array,
    "Image": lambda name, part, world: ads.background.Image(_SMALL_ARRAYS["image"](world)),
    "Mapping": _fields,
    "Fields": _fields,
    "tuple": _pair,
    "Sequence": lambda name, part, world: _SMALL_ARRAYS.get(name, lambda w: [1])(world),
    "os.PathLike": _path,
    "MedialAxis": lambda name, part, world: None,
    "LimitingInfo": lambda name, part, world: None,
    "ProgressCallback": lambda name, part, world: None,
    "Any": lambda name, part, world: (),
}
