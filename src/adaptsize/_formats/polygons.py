"""Faces with any number of corners, as blocks of cells."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.errors import MeshFileError


class Blocks(NamedTuple):
    """Blocks of triangles and quadrilaterals, and the faces that they come from."""

    cells: list[tuple[str, npt.NDArray[np.int64]]]
    faces: list[npt.NDArray[np.intp]]
    """Number of the face of each cell, one array per block."""


def as_blocks(counts: npt.NDArray[Any], nodes: npt.NDArray[Any]) -> Blocks:
    """Return faces as cells.  Polygons of five corners or more become fans of triangles.

    Parameters
    ----------
    counts : int[n_faces]
        Number of corners of each face.
    nodes : int[sum of counts]
        Corners of all faces.

    Raises
    ------
    MeshFileError
        If a face has fewer than three corners.
    """
    if len(counts) and counts.min() < 3:
        bad = int(np.argmin(counts))
        raise MeshFileError(f"has a face with {counts[bad]} corners (face {bad})")
    starts = np.cumsum(counts) - counts
    blocks = Blocks([], [])
    for n in np.unique(counts):
        faces = np.flatnonzero(counts == n)
        corners = nodes[starts[faces][:, None] + np.arange(n)].astype(np.int64)
        if n == 4:
            blocks.cells.append(("quad", corners))
            blocks.faces.append(faces)
            continue
        first = np.broadcast_to(corners[:, :1], (len(faces), n - 2))
        triangles = np.stack([first, corners[:, 1:-1], corners[:, 2:]], axis=2)
        blocks.cells.append(("triangle", triangles.reshape(-1, 3)))
        blocks.faces.append(np.repeat(faces, n - 2))
    return blocks
