"""A surface with the requested sizes by Mmg, to be filled."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.errors import BackendError
from adaptsize.remeshing.mmg import GOOD_SHARE, RIDGE_ANGLE, band_and_median, run_adapt
from adaptsize.remeshing.preparation import number_regions
from adaptsize.remeshing.protocol import Runner
from adaptsize.remeshing.sizing import Size
from adaptsize.typing import IntArray

#: The first run, on triangles of all shapes, makes far too many.  The second one corrects that.
#: Both take a tenth of the time that the volume takes.
_SURFACE_TURNS = 2
_LARGEST_SURFACE_FACTOR = 1.25
#: ``hausd`` over the tolerance, if the volume is adapted afterwards.
_SURFACE_TOLERANCE = 0.8


def adapt_surface(
    surface: SimplexMesh, ridges: IntArray, size: Size, tolerance: float, run: Runner
) -> tuple[SimplexMesh, IntArray]:
    """Return a surface with the requested edge lengths, and the ridges as they are divided now.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.  Facets of different cell tags stay separate.
    ridges : int32[n, 2]
        Edges that stay sharp.
    size : callable
    tolerance : float
        Allowed distance, in the unit of the coordinates, of the boundary of a volume that Mmg
        makes afterwards.

    Raises
    ------
    BackendError
        If Mmg fails.
    """
    regions, tags = number_regions(surface)
    made: dict[str, npt.NDArray[Any]] = {
        "points": surface.points,
        "cells": surface.cells,
        "regions": regions,
        "facets": np.empty((0, 2), np.int32),
        "facet_groups": np.empty(0, np.int32),
        "ridges": ridges,
    }
    options = {
        "class": "MmgMeshS",
        "hausd": _SURFACE_TOLERANCE * tolerance,
        "ridge_angle": RIDGE_ANGLE["MmgMeshS"],
        "n_regions": len(tags),
        "n_groups": 0,
        "required_groups": [],
        "open_boundaries": False,
    }
    factor = 1.0
    for _ in range(_SURFACE_TURNS):
        sizes = factor * size(made["points"])
        made = run_adapt(made, sizes, options, run, "adapting the surface with Mmg")
        if len(made["cells"]) == 0:
            raise BackendError("mmg returned an empty surface")
        share, median = band_and_median(size, made)
        if share >= GOOD_SHARE:
            break
        limit = _LARGEST_SURFACE_FACTOR
        factor = float(np.clip(factor / median, 1.0 / limit, limit))
    new_tags = None if surface.cell_tags is None else tags[made["regions"]]
    new = SimplexMesh(
        made["points"], made["cells"], cell_tags=new_tags, tag_names=surface.tag_names
    )
    return new, made["ridges"]
