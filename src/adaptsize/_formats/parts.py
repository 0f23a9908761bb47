"""What is written of a size function or a metric: its background, and nodal fields."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import check_type, describe
from adaptsize._formats import image, metrics, writers
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.metrics import MetricFunction


def parts_of(
    obj: object, fields: Mapping[str, npt.ArrayLike] | None
) -> tuple[SimplexMesh | CartesianGrid, dict[str, npt.ArrayLike]]:
    """Return the mesh or grid, and the nodal fields that must be written."""
    nodal: dict[str, npt.ArrayLike] = {}
    background = obj
    if isinstance(obj, SizeFunction):
        background = obj.background
        nodal["h"] = obj.values
    elif isinstance(obj, MetricFunction):
        background = obj.mesh
        nodal |= metrics.fields_of(obj.metric)
    if isinstance(background, Octree):
        background = background.mesh
    if not isinstance(background, SimplexMesh | CartesianGrid):
        raise ValueError(
            "obj must be a SimplexMesh, CartesianGrid, Octree, a SizeFunction or a MetricFunction, "
            f"got {describe(background)}"
        )
    if fields is not None:
        check_type("fields", fields, Mapping)
        for name in fields:
            check_type("names of fields", name, str)
        nodal.update(fields)
    return background, nodal


def growth_of(obj: object, n_points: int) -> dict[str, npt.ArrayLike]:
    """Return how a size function grows off its background, as constant nodal fields."""
    if not isinstance(obj, SizeFunction) or obj.g is None:
        return {}
    growth = {"h.g": obj.g} | ({"h.hmax": obj.hmax} if np.isfinite(obj.hmax) else {})
    return {name: np.full(n_points, value) for name, value in growth.items()}


def growth_in(fields: Mapping[str, npt.NDArray[Any]], name: str) -> dict[str, Any]:
    """Return g and hmax of a size function from the fields of a file, if they are there."""
    return {
        part: float(np.ravel(fields[f"{name}.{part}"])[0])
        for part in ("g", "hmax")
        if f"{name}.{part}" in fields
    }


def writing(
    background: SimplexMesh | CartesianGrid,
    nodal: Mapping[str, npt.ArrayLike],
    chosen: writers.Format,
) -> Callable[[Path], None]:
    """Return the function that writes a mesh or grid with fields to a path."""
    if isinstance(background, SimplexMesh):
        return partial(chosen.write, mesh=background.with_data(point_data=nodal))
    arrays = {name: np.asarray(values) for name, values in nodal.items()}
    for name, values in arrays.items():
        if values.shape != background.shape:
            raise ValueError(
                f"fields[{name!r}] must have shape {background.shape}, got {values.shape}"
            )
    if chosen.holds_grids:
        return partial(image.write, grid=background, fields=arrays)
    at_nodes = {name: values.reshape(-1) for name, values in arrays.items()}
    return partial(chosen.write, mesh=background.mesh.with_data(point_data=at_nodes))
