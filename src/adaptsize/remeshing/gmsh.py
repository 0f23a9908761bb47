"""Gmsh: the faces of CAD models as triangles.  Runs in a child process.

Observed behaviour that is handled here: initialize() replaces the handler of SIGINT.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.remeshing import tuning
from adaptsize.remeshing.protocol import Arrays


def triangulate(arrays: Arrays, options: Mapping[str, Any]) -> Arrays:
    """Read a CAD file and mesh its faces.

    Parameters
    ----------
    arrays : empty
    options : path, count (triangles per circle), largest (0: by the diagonal)

    Returns
    -------
    points float64[n, 3], cells int32[m, 3], cell_tags int32[m], segments int32[k, 2],
    segment_tags int32[k]
    """
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 1)
    gmsh.option.setNumber("General.Verbosity", 2)  # errors and warnings
    gmsh.model.occ.importShapes(options["path"], highestDimOnly=False)
    gmsh.model.occ.synchronize()
    *low, hx, hy, hz = gmsh.model.getBoundingBox(-1, -1)
    diagonal = float(np.linalg.norm(np.subtract((hx, hy, hz), low)))
    gmsh.option.setNumber(
        "Mesh.MeshSizeMax", options["largest"] or tuning.LARGEST_OF_CAD * diagonal
    )
    gmsh.option.setNumber("Mesh.MeshSizeMin", tuning.LEAST_OF_CAD * diagonal)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", options["count"])
    gmsh.model.mesh.generate(2)
    node_tags, coordinates, _ = gmsh.model.mesh.getNodes()
    points = coordinates.reshape(-1, 3)
    number = np.zeros(int(node_tags.max(initial=0)) + 1, np.int32)
    number[node_tags] = np.arange(len(node_tags))
    cells, cell_tags = _tagged_elements(gmsh, 2, number)
    segments, segment_tags = _tagged_elements(gmsh, 1, number)
    used, new = np.unique(np.concatenate([cells.ravel(), segments.ravel()]), return_inverse=True)
    corners, ends = new[: cells.size], new[cells.size :]
    return {
        "points": points[used],
        "cells": corners.reshape(-1, 3).astype(np.int32),
        "cell_tags": cell_tags,
        "segments": ends.reshape(-1, 2).astype(np.int32),
        "segment_tags": segment_tags,
    }


def _tagged_elements(
    gmsh: Any, dim: int, number: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the elements of all entities of a dimension, and the entity of each."""
    parts, tags = [np.empty((0, dim + 1), np.int32)], [np.empty(0, np.int32)]
    for _, tag in gmsh.model.getEntities(dim):
        corners = gmsh.model.mesh.getElementsByType(dim, tag)[1]  # 1: segments, 2: triangles
        parts.append(number[corners].reshape(-1, dim + 1))
        tags.append(np.full(len(parts[-1]), tag, np.int32))
    return np.concatenate(parts), np.concatenate(tags)
