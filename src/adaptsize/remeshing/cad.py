"""Surfaces of CAD files, triangulated by Gmsh, with the faces and edges of the model as tags."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, as_path
from adaptsize._progress import reporting
from adaptsize.background import SimplexMesh
from adaptsize.errors import MeshFileError
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.registry import check_installed
from adaptsize.typing import ProgressCallback

#: Suffixes of the files that OpenCASCADE reads.
SUFFIXES = (".step", ".stp", ".brep")


def is_cad_file(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is one for `read_cad`, by its name."""
    return Path(path).suffix.lower() in SUFFIXES


def read_cad(
    path: str | os.PathLike[str],
    *,
    elements_per_circle: float = 48.0,
    largest: float | None = None,
    timeout: float = 600.0,
    progress: ProgressCallback | bool | None = None,
) -> SimplexMesh:
    """Return the surface of a CAD model as triangles.

    Faces of the model become regions of the surface (``cell_tags``), edges become tagged segments
    (``tagged_facets``).  So `RegionSource` sets the size on a face,
    and `BoundarySource` along an edge.  `remesh` makes tetrahedra whose boundary facets carry the
    tags of the faces.

    Parameters
    ----------
    path : str or path
        STEP or BREP.
    elements_per_circle : float
        Triangles around a full circle, 6 or more.  The surface is off the model by about
        5 / n^2 radii.
    largest : float, optional
        Largest edge length, in the unit of the file; by default 1/10 of the diagonal.
    timeout : float
        Time limit in seconds.
    progress : callable, bool or None
        As for `adaptsize.remesh`.

    Returns
    -------
    SimplexMesh
        Triangles in space.

    Raises
    ------
    ValueError
        If an argument is invalid.
    MeshFileError
        If the file does not exist or holds no faces.
    BackendUnavailableError
        If Gmsh is not installed.
    BackendError
        If Gmsh cannot read the file, with its message.

    Notes
    -----
    Tags are the numbers that Gmsh gives to faces and edges, in the order of the file.  Names of
    faces in STEP files are not read, because Gmsh leaves them out.

    Gmsh (GPL) is installed with ``pip install "adaptsize[gmsh]"``.  It runs in a child process.

    Examples
    --------
    >>> part = read_cad("part.step")  # doctest: +SKIP
    >>> size = size_function(part, sources=RegionSource(3, 0.5))  # doctest: +SKIP
    """
    file = as_path("path", path)
    if not is_cad_file(file):
        raise ValueError(f"path must end in {', '.join(SUFFIXES)}, got {os.fspath(path)!r}")
    count = as_number("elements_per_circle", elements_per_circle, lower=6.0)
    limit = 0.0 if largest is None else as_number("largest", largest, lower=0.0, strict=True)
    seconds = as_number("timeout", timeout, lower=0.0, strict=True)
    if not file.is_file():
        raise MeshFileError(f"{file} does not exist")
    check_installed("gmsh")
    with reporting(progress) as report:
        run = IsolatedRunner("gmsh", seconds, time.monotonic() + seconds, report)
        made = run(
            "adaptsize.remeshing.cad:triangulate",
            "triangulating the CAD model with Gmsh",
            {},
            {"path": str(file.resolve()), "count": count, "largest": limit},
        )
    if len(made["cells"]) == 0:
        raise MeshFileError(f"{file} holds no faces")
    return SimplexMesh(
        made["points"],
        made["cells"],
        cell_tags=made["cell_tags"],
        tagged_facets=made["segments"],
        facet_tags=made["segment_tags"],
    )


def triangulate(
    arrays: Mapping[str, npt.NDArray[Any]], options: Mapping[str, Any]
) -> dict[str, npt.NDArray[Any]]:
    """Read a CAD file and mesh its faces.  Runs in the child process.

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
    gmsh.option.setNumber("Mesh.MeshSizeMax", options["largest"] or 0.1 * diagonal)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", options["count"])
    gmsh.model.mesh.generate(2)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    number = np.zeros(int(tags.max(initial=0)) + 1, np.int32)
    number[tags] = np.arange(len(tags))
    cells, cell_tags = _elements(gmsh, 2, 2, number)
    segments, segment_tags = _elements(gmsh, 1, 1, number)
    used, new = np.unique(np.concatenate([cells.ravel(), segments.ravel()]), return_inverse=True)
    corners, ends = new[: cells.size], new[cells.size :]
    return {
        "points": coordinates.reshape(-1, 3)[used],
        "cells": corners.reshape(-1, 3).astype(np.int32),
        "cell_tags": cell_tags,
        "segments": ends.reshape(-1, 2).astype(np.int32),
        "segment_tags": segment_tags,
    }


def _elements(
    gmsh: Any, dim: int, element_type: int, number: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the elements of all entities of a dimension, and the entity of each."""
    parts, tags = [np.empty((0, dim + 1), np.int32)], [np.empty(0, np.int32)]
    for _, tag in gmsh.model.getEntities(dim):
        corners = gmsh.model.mesh.getElementsByType(element_type, tag)[1]
        parts.append(number[corners].reshape(-1, dim + 1))
        tags.append(np.full(len(parts[-1]), tag, np.int32))
    return np.concatenate(parts), np.concatenate(tags)
