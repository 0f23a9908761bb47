"""Straight cells of order 2: a node in the middle of each edge."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import accumulate
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh
from adaptsize.background.topology import unique_rows

#: Names of cells by the numbers of corners, and the edges whose middles follow the corners: the
#: order of VTK, Abaqus and Nastran.
NAMES = {"line": "line3", "triangle": "triangle6", "tetra": "tetra10"}
_EDGES = {"line": [[0, 1]], "triangle": [[0, 1], [1, 2], [2, 0]]}
_EDGES["tetra"] = [*_EDGES["triangle"], [0, 3], [1, 3], [2, 3]]


def with_middles(raw: RawMesh) -> RawMesh:
    """Return a mesh of simplices with a node in the middle of each edge, after the corners.

    Nodal fields have the mean of both ends there.
    """
    pairs = [cells[:, _EDGES[name]].reshape(-1, 2) for name, cells in raw.blocks]
    edges, number = unique_rows(np.concatenate(pairs).astype(np.int32), len(raw.points))
    middles = np.split(number + len(raw.points), [*accumulate(map(len, pairs))][:-1])
    blocks = [
        (NAMES[name], np.column_stack([cells, own.reshape(len(cells), -1)]))
        for (name, cells), own in zip(raw.blocks, middles, strict=True)
    ]
    return replace(
        raw,
        points=_at_nodes(raw.points, edges),
        blocks=blocks,
        point_data=_with_means(raw.point_data, edges),
    )


def _with_means(
    fields: Mapping[str, npt.NDArray[Any]], edges: npt.NDArray[Any]
) -> dict[str, npt.NDArray[Any]]:
    return {name: _at_nodes(np.asarray(values), edges) for name, values in fields.items()}


def _at_nodes(values: npt.NDArray[Any], edges: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return values at the corners followed by those in the middles; integers become floats."""
    ends = values[edges].astype(values.dtype if values.dtype.kind == "f" else np.float64)
    return np.concatenate([values, 0.5 * ends[:, 0] + 0.5 * ends[:, 1]])
