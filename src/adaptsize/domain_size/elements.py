"""A mesh with a given number of elements."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from adaptsize._checks import as_number, check_type
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.domain_size.api import size_function
from adaptsize.domain_size.report import SizeReport
from adaptsize.domain_size.request import GRADIENT_LIMIT, TOLERANCE
from adaptsize.errors import ResolutionWarning
from adaptsize.remeshing.driver import check_backend, remesh
from adaptsize.typing import ProgressCallback

#: A mesh with a number of elements within this share of the wanted one is accepted, ...
_ACCEPTED = 0.15
#: ... and the best of this many meshes is returned.
_MAX_MESHES = 3

Sized: TypeAlias = tuple[SizeFunction, SizeReport]


class MeshOfElements(NamedTuple):
    """A mesh, and the sizes that it was made for."""

    mesh: SimplexMesh
    size: SizeFunction
    report: SizeReport


def remesh_to_elements(
    mesh: SimplexMesh,
    elements: float,
    *,
    target: Literal["auto", "tetrahedra", "triangles"] = "auto",
    backend: str = "auto",
    tolerance: float | None = None,
    timeout: float | None = 3600.0,
    strict: bool = False,
    progress: ProgressCallback | bool | None = None,
    **size_options: Any,
) -> MeshOfElements:
    """Return a mesh of a domain with a given number of elements, within 15 %.

    The sizes are those of `size_function` with this predicted number.  If the mesh has another
    number, new sizes are predicted with the ratio of the two: at most three meshes are made, and
    the one with the nearest number is returned.

    Parameters
    ----------
    mesh : SimplexMesh
        As in `remesh`.
    elements : float
        Wanted number of cells of the new mesh, >= 1.
    target, backend, timeout, strict, progress
        As in `remesh`.
    tolerance : float, optional
        As in `size_function` and in `remesh`.  The default is 1e-3, or more where so few elements
        require it.
    **size_options
        Further arguments of `size_function`.  What is given here is kept; the other parameters
        are relaxed or tightened.

    Returns
    -------
    MeshOfElements
        The mesh, its size function and the report, in this order.

    Raises
    ------
    ValueError
        As in `size_function` and `remesh`.
    BackendError
        As in `remesh`.

    Warns
    -----
    ResolutionWarning
        If none of the meshes has a number within 15 %.

    Examples
    --------
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> mesh, size, report = remesh_to_elements(square, 1000)
    >>> 850 <= mesh.n_cells <= 1150
    True
    """
    check_type("mesh", mesh, SimplexMesh)
    check_backend(mesh, target, backend)

    def sized(number: float) -> Sized:
        return size_function(
            mesh,
            elements=number,
            tolerance=tolerance,
            progress=progress,
            full_output=True,
            **size_options,
        )

    def meshed(size: SizeFunction, report: SizeReport) -> SimplexMesh:
        return remesh(
            mesh,
            size,
            target=target,
            backend=backend,
            g=size_options.get("g", GRADIENT_LIMIT),
            hmax=report.hmax,
            tolerance=tolerance_of(report, tolerance),
            timeout=timeout,
            strict=strict,
            progress=progress,
        )

    return reach_elements(elements, sized, meshed)


def tolerance_of(report: SizeReport, tolerance: float | None) -> float:
    """Return the tolerance of a mesh: the given one, or the default that the sizes allow."""
    if tolerance is not None:
        return as_number("tolerance", tolerance, lower=0.0, strict=True)
    return max(TOLERANCE, report.tolerance) if np.isfinite(report.tolerance) else TOLERANCE


def reach_elements(
    elements: float,
    sized: Callable[[float], Sized],
    meshed: Callable[[SizeFunction, SizeReport], SimplexMesh],
) -> MeshOfElements:
    """Return the best of up to three meshes, by their numbers of elements.

    Parameters
    ----------
    elements : float
        Wanted number of cells.
    sized : callable
        Returns the sizes for a predicted number of elements, and their report.
    meshed : callable
        Returns the mesh for sizes and their report.
    """
    elements = as_number("elements", elements, lower=1.0)
    best: MeshOfElements | None = None
    least, wanted = np.inf, elements
    for _ in range(_MAX_MESHES):
        size, report = sized(wanted)
        mesh = meshed(size, report)
        off = abs(mesh.n_cells / elements - 1.0)
        if off < least:
            best, least = MeshOfElements(mesh, size, report), off
        if off <= _ACCEPTED:
            break
        # Sizes larger by a factor s have s^-dim as many elements, and s^-cell_dim cells.
        power = mesh.dim / mesh.cell_dim
        wanted = max(report.n_elements * math.pow(elements / mesh.n_cells, power), 1.0)
    assert best is not None
    if least > _ACCEPTED:
        warnings.warn(
            f"the mesh has {best.mesh.n_cells} elements instead of {elements:.6g}: "
            "the mesh generator, details of the domain or the given parameters do not allow it",
            ResolutionWarning,
            stacklevel=3,
        )
    return best
