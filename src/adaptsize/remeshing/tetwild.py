"""fTetWild, through pytetwild: tetrahedra from any surface, however dirty.

What is measured of it and handled here: a size field only refines below the
global edge length, so that is the largest size; outside the field's background
the global length holds, so the background covers a box around the part; tags
are lost, so the caller looks them up in the old mesh.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.remeshing.protocol import Problem, RawMesh, Runner, Task

#: Edge length over the diagonal where no size is given: fTetWild's own default.
_FREE_LENGTH = 0.05

#: fTetWild starts with edges up to about this over the diagonal and keeps them, whatever is asked,
#: unless told to coarsen.  That however may leave the envelope: one part came out 4.5e-3 of
#: the diagonal off instead of 6e-4.  So it is done only where it is needed.
_COARSEST_START = 1.0 / 12.0


@dataclass(frozen=True)
class TetWildBackend:
    """Adapter to pytetwild >= 0.4.2, which takes size fields."""

    name: str = "tetwild"
    package: str = "pytetwild"
    install: str = 'pip install "pytetwild>=0.4.2,<0.5"'
    tasks: frozenset[Task] = frozenset({"surface to tetrahedra", "tetrahedra"})
    needs_volume: bool = False
    keeps_required_facets: bool = False

    def solve(self, problem: Problem, run: Runner) -> RawMesh:
        """Return tetrahedra; regions and facets are not known to fTetWild."""
        mesh = problem.mesh
        faces = mesh.cells if problem.task == "surface to tetrahedra" else problem.facet_nodes
        arrays: dict[str, npt.NDArray[Any]] = {"points": mesh.points, "faces": faces}
        options: dict[str, Any] = {
            "epsilon": problem.tolerance / mesh.diagonal,
            "coarsen": False,
            "filtered": problem.task == "surface to tetrahedra",
            "edge_length": _FREE_LENGTH * mesh.diagonal,
        }
        if problem.size is not None:
            from adaptsize.remeshing.sizing import sample_in_box

            points, cells, sizes = sample_in_box(problem.size, mesh, problem.size_nodes)
            arrays |= {"size_points": points, "size_cells": cells, "sizes": sizes}
            options["edge_length"] = min(float(sizes.max()), mesh.diagonal)
            options["coarsen"] = options["edge_length"] > _COARSEST_START * mesh.diagonal
        made = run(
            "adaptsize.remeshing.tetwild:tetrahedralize",
            "tetrahedralizing with pytetwild",
            arrays,
            options,
        )
        raw = RawMesh(made["points"], made["cells"])
        if options["filtered"]:
            return raw
        # Interfaces spoil the winding number by which fTetWild tells inside from outside.
        from adaptsize.remeshing.restoration import inside_only

        return inside_only(raw, problem)


def tetrahedralize(
    arrays: Mapping[str, npt.NDArray[Any]], options: Mapping[str, Any]
) -> dict[str, npt.NDArray[Any]]:
    """Call pytetwild; runs in the child process.

    Parameters
    ----------
    arrays : points float64[n, 3], faces int32[m, 3]; size_points, size_cells, sizes if any
    options : epsilon (over the diagonal), edge_length (absolute), coarsen, filtered

    Returns
    -------
    points float64[n, 3], cells int32[m, 4]
    """
    from pytetwild import pytetwild

    field: dict[str, Any] = {}
    if "sizes" in arrays:
        field = {
            "bg_vertices": arrays["size_points"],
            "bg_tets": arrays["size_cells"],
            "bg_values": arrays["sizes"],
        }
    points, cells = pytetwild.tetrahedralize(
        np.ascontiguousarray(arrays["points"]),
        np.ascontiguousarray(arrays["faces"], dtype=np.int32),
        edge_length_abs=options["edge_length"],
        epsilon=options["epsilon"],
        vtk_ordering=True,  # the other ordering gives negative volumes
        quiet=True,
        coarsen=options["coarsen"],
        disable_filtering=not options["filtered"],
        **field,
    )
    return {"points": points, "cells": cells.astype(np.int32)}
