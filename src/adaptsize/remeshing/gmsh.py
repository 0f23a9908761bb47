"""Gmsh: tetrahedra and surfaces from clean surfaces.

Observed behaviour that is handled here:

* Gmsh takes the minimum of the given sizes and three other sources unless these are disabled.
* A view of list data works as a background.  A view on the current model is refused.
* initialize() replaces the handler of SIGINT.

Gmsh has no geometric tolerance: coarse sizes on curved surfaces cut corners.  Edges inside a
volume are some 20 % longer than requested.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.remeshing.protocol import Backend, Problem, RawMesh, Runner, Task
from adaptsize.typing import FloatArray

#: Radians between two triangles at which a surface is cut into patches.
_CREASE_ANGLE = math.radians(40.0)
#: Gmsh's numbers of element types by their dimension.
_TYPES = {1: 1, 2: 2, 3: 4}


class GmshBackend(Backend):
    """Adapter to Gmsh >= 4.11 (GPL).  It transfers neither tags nor regions of surfaces."""

    name = "gmsh"
    package = "gmsh"
    install = 'pip install "adaptsize[gmsh]"'
    tasks: frozenset[Task] = frozenset({"surface to tetrahedra", "surface"})

    def solve(self, problem: Problem, run: Runner) -> RawMesh:
        """Return the new mesh.  The caller restores the tags."""
        from adaptsize.remeshing.sizing import sample_in_box

        assert problem.size is not None
        points, cells, sizes = sample_in_box(problem.size, problem.mesh, problem.size_nodes)
        arrays: dict[str, npt.NDArray[Any]] = {
            "points": problem.mesh.points,
            "size_points": points,
            "size_cells": cells,
            "sizes": sizes,
        }
        made = run(
            "adaptsize.remeshing.gmsh:follow_surface",
            "meshing with Gmsh",
            {**arrays, "faces": problem.mesh.cells},
            {"volume": problem.task == "surface to tetrahedra"},
        )
        return RawMesh(made["points"], made["cells"])


def follow_surface(
    arrays: Mapping[str, npt.NDArray[Any]], options: Mapping[str, Any]
) -> dict[str, npt.NDArray[Any]]:
    """Remesh a closed surface, and fill it if ``volume``.  Runs in the child process.

    Parameters
    ----------
    arrays : points float64[n, 3], faces int32[m, 3], size_points, size_cells, sizes
    options : volume

    Returns
    -------
    points float64[n, 3], cells int32[m, 3 or 4]
    """
    import gmsh

    _start(gmsh)
    surface = gmsh.model.addDiscreteEntity(2)
    tags = np.arange(1, len(arrays["points"]) + 1)
    gmsh.model.mesh.addNodes(2, surface, tags, arrays["points"].ravel())
    corners = (arrays["faces"].astype(np.int64) + 1).ravel()
    gmsh.model.mesh.addElementsByType(surface, _TYPES[2], [], corners)
    gmsh.model.mesh.classifySurfaces(_CREASE_ANGLE, True, True, math.pi)
    gmsh.model.mesh.createGeometry()
    if options["volume"]:
        patches = [tag for _, tag in gmsh.model.getEntities(2)]
        gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop(patches)])
    gmsh.model.geo.synchronize()
    _use_sizes_only(gmsh, arrays, 1.0)
    gmsh.model.mesh.generate(2)
    if options["volume"]:
        # Factor on sizes inside a volume.  Without it, edges there are 1.2 to 1.3 times too long.
        _use_sizes_only(gmsh, arrays, 0.8)
        gmsh.model.mesh.generate(3)
    dim = 3 if options["volume"] else 2
    points, number = _nodes(gmsh)
    cells = number[gmsh.model.mesh.getElementsByType(_TYPES[dim])[1]]
    return {"points": points, "cells": cells.reshape(-1, dim + 1)}


def _start(gmsh: Any) -> None:
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 1)
    gmsh.option.setNumber("General.Verbosity", 2)  # errors and warnings


def _use_sizes_only(gmsh: Any, arrays: Mapping[str, npt.NDArray[Any]], factor: float) -> None:
    """Set the sizes times ``factor`` as the background field, and disable other sources."""
    for name in ("FromPoints", "FromCurvature", "ExtendFromBoundary", "FromParametricPoints"):
        gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)
    cells = arrays["size_cells"]
    corners = np.zeros((len(cells), cells.shape[1], 3))
    points = arrays["size_points"]
    corners[:, :, : points.shape[1]] = points[cells]
    # One row per cell: all x, all y, all z, then the sizes.
    rows = np.concatenate(
        [corners.transpose(0, 2, 1).reshape(len(cells), -1), factor * arrays["sizes"][cells]],
        axis=1,
    )
    view = gmsh.view.add("size")
    gmsh.view.addListData(view, "SS" if cells.shape[1] == 4 else "ST", len(cells), rows.ravel())
    field = gmsh.model.mesh.field.add("PostView")
    gmsh.model.mesh.field.setNumber(field, "ViewTag", view)
    gmsh.model.mesh.field.setAsBackgroundMesh(field)


def _nodes(gmsh: Any) -> tuple[FloatArray, npt.NDArray[np.int32]]:
    """Return the points, and the index of each node by its tag."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    number = np.zeros(int(tags.max(initial=0)) + 1, np.int32)
    number[tags] = np.arange(len(tags))
    return coordinates.reshape(-1, 3), number


def _tagged_elements(
    gmsh: Any, dim: int, number: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the elements of all entities of a dimension, and the entity of each."""
    parts, tags = [np.empty((0, dim + 1), np.int32)], [np.empty(0, np.int32)]
    for _, tag in gmsh.model.getEntities(dim):
        corners = gmsh.model.mesh.getElementsByType(_TYPES[dim], tag)[1]
        parts.append(number[corners].reshape(-1, dim + 1))
        tags.append(np.full(len(parts[-1]), tag, np.int32))
    return np.concatenate(parts), np.concatenate(tags)


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

    _start(gmsh)
    gmsh.model.occ.importShapes(options["path"], highestDimOnly=False)
    gmsh.model.occ.synchronize()
    *low, hx, hy, hz = gmsh.model.getBoundingBox(-1, -1)
    diagonal = float(np.linalg.norm(np.subtract((hx, hy, hz), low)))
    gmsh.option.setNumber("Mesh.MeshSizeMax", options["largest"] or 0.1 * diagonal)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", options["count"])
    gmsh.model.mesh.generate(2)
    points, number = _nodes(gmsh)
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
