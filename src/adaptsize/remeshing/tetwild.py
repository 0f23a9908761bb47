"""fTetWild, through pytetwild: tetrahedra from any surface, also with defects.

Observed behaviour that is handled here:

* A sizing field only refines below the global edge length, so this is set to the largest size.
* Outside the background of the field the global length applies.  Therefore the background
  covers a box around the part.
* Tags are lost, so the caller looks them up in the old mesh.
* The winding number that separates inside from outside is that of facets moved within the envelope.
  Where facets cross at small angles, or nearly coincide, it is wrong far from the surface: a public
  part lost 45 tolerances.  There the number of the given surface decides, and facets inside of the
  solid are not passed.
* It refines until the energy of the worst cell is below a threshold.  Beside sharp edges that are
  closer than the sizes, this takes hundreds of thousands of cells.  Therefore the threshold is
  larger on surfaces that were rough.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from adaptsize._progress import Stage
from adaptsize.remeshing import tuning
from adaptsize.remeshing.protocol import Arrays, Backend, MeshingProblem, Task
from adaptsize.typing import BoolArray, FloatArray

if TYPE_CHECKING:
    from adaptsize.remeshing.isolation import IsolatedRunner


class TetWildBackend(Backend):
    """Adapter to pytetwild >= 0.4.2, which accepts sizing fields."""

    name = "tetwild"
    package = "pytetwild"
    install = 'pip install "pytetwild>=0.4.2,<0.5"'
    tasks: frozenset[Task] = frozenset({"surface to tetrahedra", "tetrahedra"})

    def solve(self, problem: MeshingProblem, run: IsolatedRunner) -> Arrays:
        """Return tetrahedra, without regions and facets."""
        mesh = problem.mesh
        enclosing = problem.enclosing
        faces = mesh.cells if problem.task == "surface to tetrahedra" else problem.facets.nodes
        if enclosing is not None:
            faces = mesh.cells[enclosing.bounding]
        arrays: dict[str, npt.NDArray[Any]] = {"points": mesh.points, "faces": faces}
        # Edge length over the diagonal if no size is given: fTetWild's default.
        options: dict[str, Any] = {
            "epsilon": problem.tolerance / mesh.diagonal,
            "coarsen": False,
            "filtered": problem.task == "surface to tetrahedra" and enclosing is None,
            "edge_length": tuning.EDGE_LENGTH * mesh.diagonal,
            "stop_energy": tuning.STOP_ENERGY_OF_ROUGH if problem.is_rough else tuning.STOP_ENERGY,
        }
        if problem.size is not None:
            from adaptsize.remeshing.sizing import sample_in_box

            points, cells, sizes = sample_in_box(problem.size, mesh, problem.size_nodes)
            arrays |= {"size_points": points, "size_cells": cells, "sizes": sizes}
            options["edge_length"] = min(float(sizes.max()), mesh.diagonal)
            options["coarsen"] = options["edge_length"] > tuning.COARSENED * mesh.diagonal
        stage = Stage("tetrahedralizing", "fTetWild")
        made = run("adaptsize.remeshing.tetwild:tetrahedralize", stage, arrays, options)
        if options["filtered"]:
            return made
        if enclosing is not None:
            corners = made["points"][made["cells"]]
            off = mesh.locator.nearest(corners.mean(axis=1))[2]
            # The sides of cells are as near to the surface as this.
            is_near = off <= tuning.BESIDE_ENVELOPE * problem.tolerance
            is_in = mostly_inside(corners, enclosing.contains, is_near)
            return {**made, "cells": made["cells"][is_in]}
        # Interfaces would disturb the winding number that separates inside from outside.  Instead,
        # the cells whose centroids lie in the old mesh are kept.
        off = mesh.locator.nearest(made["points"][made["cells"]].mean(axis=1))[2]
        return {**made, "cells": made["cells"][off <= 1e-12 * mesh.diagonal]}


def mostly_inside(
    corners: FloatArray, contains: Callable[[FloatArray], BoolArray], is_near: BoolArray
) -> BoolArray:
    """Return which tetrahedra, float64[n, 4, 3], have their centroids inside.

    Of those near to the surface, which have most of some points in them inside.
    """
    is_in = np.empty(len(corners), np.bool_)
    is_in[~is_near] = contains(corners[~is_near].mean(axis=1))
    # The centroid, and points towards the corners and towards the facets.
    weights = np.concatenate([np.full((1, 4), 0.25), 0.1 + 0.6 * np.eye(4), 0.3 - 0.2 * np.eye(4)])
    points = np.einsum("kc,ncd->nkd", weights, corners[is_near])
    inside = contains(points.reshape(-1, 3)).reshape(-1, len(weights))
    is_in[is_near] = 2 * inside.sum(axis=1) > len(weights)
    return is_in


def tetrahedralize(arrays: Arrays, options: Mapping[str, Any]) -> Arrays:
    """Call pytetwild.  Runs in the child process.

    Parameters
    ----------
    arrays : points float64[n, 3], faces int32[m, 3]; size_points, size_cells, sizes if any
    options : epsilon (over the diagonal), edge_length (absolute), coarsen, filtered, stop_energy

    Returns
    -------
    points float64[n, 3], cells int32[m, 4]
    """
    field: dict[str, Any] = {}
    if "sizes" in arrays:
        field = {
            "bg_vertices": arrays["size_points"],
            "bg_tets": arrays["size_cells"],
            "bg_values": arrays["sizes"],
        }
    points, cells = _import_pytetwild().tetrahedralize(
        np.ascontiguousarray(arrays["points"]),
        np.ascontiguousarray(arrays["faces"], dtype=np.int32),
        edge_length_abs=options["edge_length"],
        epsilon=options["epsilon"],
        vtk_ordering=True,  # the other ordering gives negative volumes
        quiet=not options.get("verbose", False),
        stop_energy=options["stop_energy"],
        coarsen=options["coarsen"],
        disable_filtering=not options["filtered"],
        **field,
    )
    return {"points": points, "cells": cells.astype(np.int32)}


def _import_pytetwild() -> Any:
    """Import pytetwild without pyvista, which may be missing, and takes a second.

    It imports pyvista for an accessor, which is not used here.
    """
    sys.modules.setdefault("pytetwild._accessor", ModuleType("pytetwild._accessor"))
    from pytetwild import pytetwild

    return pytetwild
