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
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.remeshing.protocol import Problem, RawMesh, Runner, Task
from adaptsize.typing import FloatArray

#: Radians between two triangles at which a surface is cut into patches.
_CREASE_ANGLE = math.radians(40.0)
#: Gmsh's numbers of element types.
_LINE, _TRIANGLE, _TETRAHEDRON = 1, 2, 4


@dataclass(frozen=True)
class GmshBackend:
    """Adapter to Gmsh >= 4.11 (GPL).  It transfers neither tags nor regions of surfaces."""

    name: str = "gmsh"
    package: str = "gmsh"
    install: str = 'pip install "adaptsize[gmsh]"'
    tasks: frozenset[Task] = frozenset({"surface to tetrahedra", "surface"})
    needs_volume: bool = False
    keeps_required_facets: bool = False

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
    gmsh.model.mesh.addElementsByType(surface, _TRIANGLE, [], corners)
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
    return _cells(gmsh, _TETRAHEDRON if options["volume"] else _TRIANGLE, 3)


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


def _cells(gmsh: Any, element_type: int, dim: int) -> dict[str, npt.NDArray[Any]]:
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    number = np.zeros(int(tags.max(initial=0)) + 1, np.int32)
    number[tags] = np.arange(len(tags))
    corners = gmsh.model.mesh.getElementsByType(element_type)[1]
    width = {_TRIANGLE: 3, _TETRAHEDRON: 4}[element_type]
    points: FloatArray = coordinates.reshape(-1, 3)[:, :dim]
    return {"points": points, "cells": number[corners].reshape(-1, width)}
