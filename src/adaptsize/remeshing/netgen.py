"""Netgen: tetrahedra between the given triangles of a closed surface.

Mmg needs a first volume mesh.  Netgen keeps all nodes and triangles of the surface, where fTetWild
moves the surface within its tolerance, which Mmg then amplifies.  It refuses or fails on surfaces
that are open, not manifold or self-intersecting; fTetWild fills those.

Observed behaviour that is handled here:

* Arrays returned by a mesh are views that end with it, so they are copied.
* Tetrahedra have the opposite orientation.
* Surfaces with slivers may take very long, so there is a limit of processor time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsize._checks import place_text
from adaptsize._progress import Stage
from adaptsize.errors import BackendError
from adaptsize.geometry.enclosed import enclosed_measure, is_oriented
from adaptsize.remeshing import tuning
from adaptsize.remeshing.protocol import Arrays

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.remeshing.isolation import IsolatedRunner


def fill(surface: SimplexMesh, run: IsolatedRunner) -> Arrays:
    """Return tetrahedra whose boundary is exactly ``surface``.

    Returns
    -------
    mapping of str to array
        ``points`` and ``cells``.  The first points are those of the surface.

    Raises
    ------
    BackendError
        If Netgen is not installed, fails, or makes something else.  If the surface is not closed,
        or crosses itself: then Netgen is not started, since it would fail.
    """
    from adaptsize.remeshing.crossings import crossing_facets  # not in the child

    if not can_fill(surface):
        raise BackendError("netgen cannot fill the surface, which is not closed or not oriented")
    crossing = crossing_facets(surface)
    if len(crossing.cells):
        place = place_text(crossing.places[crossing.depths.argmax()], 4)
        raise BackendError(f"netgen cannot fill the surface, which crosses itself at {place}")
    seconds = min(run.seconds, tuning.SECONDS + tuning.SECONDS_PER_TRIANGLE * surface.n_cells)
    made = replace(run, backend="netgen", seconds=seconds)(
        "adaptsize.remeshing.netgen:tetrahedralize",
        Stage("filling the surface", "Netgen"),
        {"points": surface.points, "faces": surface.cells},
        {},
    )
    if not _fills(made, surface):
        raise BackendError("netgen returned a mesh whose boundary is not the surface")
    return made


def can_fill(surface: SimplexMesh) -> bool:
    """Whether Netgen is installed, and the surface is closed and oriented."""
    return find_spec("netgen") is not None and is_oriented(surface)


def _fills(made: Arrays, surface: SimplexMesh) -> bool:
    """Whether the cells are positive, and their boundary is the surface."""
    from adaptsize.background import SimplexMesh
    from adaptsize.background.topology import unique_rows

    n = surface.n_points
    if len(made["cells"]) == 0 or not np.array_equal(made["points"][:n], surface.points):
        return False
    mesh = SimplexMesh(made["points"], made["cells"])
    volumes = mesh.signed_measures
    enclosed = enclosed_measure(surface)
    if not (volumes > 0.0).all() or abs(volumes.sum() - enclosed) > 1e-9 * enclosed:
        return False
    boundary = mesh.facets[mesh.facet_cell_counts == 1]
    rows = np.concatenate([boundary, np.sort(surface.cells, axis=1)])
    return len(boundary) == surface.n_cells == len(unique_rows(rows, mesh.n_points)[0])


def tetrahedralize(arrays: Arrays, _options: Mapping[str, Any]) -> Arrays:
    """Call Netgen.  Runs in the child process.

    Parameters
    ----------
    arrays : points float64[n, 3], faces int32[m, 3]

    Returns
    -------
    points float64[n, 3], cells int32[m, 4]
    """
    from netgen import meshing

    meshing.SetMessageImportance(0)
    mesh = meshing.Mesh(dim=3)
    mesh.AddPoints(np.ascontiguousarray(arrays["points"]))
    descriptor = mesh.Add(meshing.FaceDescriptor(surfnr=1, domin=1, domout=0, bc=1))
    faces = np.ascontiguousarray(arrays["faces"], dtype=np.int32)
    mesh.AddElements(dim=2, index=descriptor, data=faces, base=0)
    # Mmg improves the cells, so Netgen need not.
    mesh.GenerateVolumeMesh(meshing.MeshingParameters(optsteps3d=0))
    cells = np.array(mesh.Elements3D().NumPy()["nodes"][:, :4]) - 1
    return {
        "points": np.array(mesh.Coordinates()),
        "cells": cells[:, [1, 0, 2, 3]].astype(np.int32),
    }
