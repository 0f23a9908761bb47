"""A mesh with a given number of elements or nodes."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from adaptsize._checks import as_number, as_tolerance, check_type
from adaptsize._defaults import GRADIENT_LIMIT, TOLERANCE
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.background.splitting import with_short_edges
from adaptsize.domain_size.api import size_function
from adaptsize.domain_size.report import SizeReport
from adaptsize.errors import ResolutionWarning
from adaptsize.remeshing.driver import check_backend, remesh
from adaptsize.typing import ProgressCallback

#: A mesh with a number of elements within this share of the wanted one is accepted, ...
_ACCEPTED = 0.15
#: ... and the best of this many meshes is returned.
_MAX_MESHES = 3
#: Edges of a refined mesh are at most this times the size.
_SHORT = 0.5
#: A refined mesh has at most this many cells.
_MAX_CELLS = 2_000_000

Sized: TypeAlias = tuple[SizeFunction, SizeReport]


class MeshOfElements(NamedTuple):
    """A mesh, and the sizes that it was made for."""

    mesh: SimplexMesh
    size: SizeFunction
    report: SizeReport


def remesh_to_elements(
    mesh: SimplexMesh,
    elements: float | None = None,
    *,
    nodes: float | None = None,
    target: Literal["auto", "tetrahedra", "triangles"] = "auto",
    backend: str = "auto",
    tolerance: float | None = None,
    timeout: float | None = 3600.0,
    strict: bool = False,
    progress: ProgressCallback | bool | None = None,
    **size_options: Any,
) -> MeshOfElements:
    """Return a mesh of a domain with a given number of elements or nodes, within 15 %.

    The sizes are those of `size_function` with this predicted number.  If the mesh has another
    number, new sizes are predicted with the ratio of the two: at most three meshes are made, and
    the one with the nearest number is returned.  A plane mesh is refined before the second one.

    Parameters
    ----------
    mesh : SimplexMesh
        As in `remesh`.
    elements : float, optional
        Requested number of cells of the new mesh, >= 1.
    nodes : float, optional
        Requested number of nodes, >= 1.  Either this or ``elements``.
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
    >>> 850 <= remesh_to_elements(square, nodes=1000).mesh.n_points <= 1150
    True
    """
    check_type("mesh", mesh, SimplexMesh)
    check_backend(mesh, target, backend)
    if (elements is None) == (nodes is None):
        given = "none" if nodes is None else "both"
        raise ValueError(f"one of elements and nodes must be given, got {given}")

    def sized(elements: float | None, nodes: float | None) -> Sized:
        return size_function(
            mesh,
            elements=elements,
            nodes=nodes,
            tolerance=tolerance,
            progress=progress,
            full_output=True,
            **size_options,
        )

    def meshed(old: SimplexMesh, size: SizeFunction, report: SizeReport) -> SimplexMesh:
        return remesh(
            old,
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

    return reach_number(mesh, elements, nodes, sized, meshed)


def tolerance_of(report: SizeReport, tolerance: float | None) -> float:
    """Return the tolerance of a mesh: the given one, or the default that the sizes allow."""
    if tolerance is not None:
        return as_tolerance("tolerance", tolerance)
    return (
        min(max(TOLERANCE, report.tolerance), 1.0) if np.isfinite(report.tolerance) else TOLERANCE
    )


def reach_number(
    mesh: SimplexMesh,
    elements: float | None,
    nodes: float | None,
    sized: Callable[[float | None, float | None], Sized],
    meshed: Callable[[SimplexMesh, SizeFunction, SizeReport], SimplexMesh],
) -> MeshOfElements:
    """Return the best of up to three meshes, by their numbers of elements or nodes.

    A mesh of triangles in the plane is refined if the first new mesh misses the number.  Mmg
    leaves edges as they are within sqrt 2 of the size, so from a mesh with edges of a few lengths
    it cannot make any number: of 800 triangles in a regular grid it makes 800 or 417, not 641.
    From short edges it builds all new ones.  It visits them in the order of the file, so that they
    are also numbered at random: from regular grids in order, numbers were off by up to 35 %, and
    by up to 6 % without order.

    Parameters
    ----------
    mesh : SimplexMesh
        The given mesh.
    elements, nodes : float or None
        Requested number of cells, or of nodes.
    sized : callable
        Returns the sizes for a predicted number of elements or nodes, and their report.
    meshed : callable
        Returns the mesh from a given mesh, sizes and their report.
    """
    counts_nodes = nodes is not None
    what = "nodes" if counts_nodes else "elements"
    goal = as_number(what, nodes if counts_nodes else elements, lower=1.0)
    best: MeshOfElements | None = None
    old, least, wanted = mesh, np.inf, goal
    for _ in range(_MAX_MESHES):
        size, report = sized(None, wanted) if counts_nodes else sized(wanted, None)
        new = meshed(old, size, report)
        made = new.n_points if counts_nodes else new.n_cells
        off = abs(made / goal - 1.0)
        if off < least:
            best, least = MeshOfElements(new, size, report), off
        if off <= _ACCEPTED:
            break
        if old is mesh and mesh.dim == mesh.cell_dim == 2:
            old = _without_order(with_short_edges(mesh, size, _SHORT, _MAX_CELLS))
            continue  # the first mesh says little about one from this
        # Sizes larger by a factor s have s^-dim as many elements, and s^-cell_dim cells.
        power = new.dim / new.cell_dim
        predicted = report.n_nodes if counts_nodes else report.n_elements
        wanted = max(predicted * math.pow(goal / made, power), 1.0)
    assert best is not None
    if least > _ACCEPTED:
        made = best.mesh.n_points if counts_nodes else best.mesh.n_cells
        warnings.warn(
            f"the mesh has {made} {what} instead of {goal:.6g}: "
            "the mesh generator, details of the domain or the given parameters do not allow it",
            ResolutionWarning,
            stacklevel=3,
        )
    return best


def _without_order(mesh: SimplexMesh) -> SimplexMesh:
    """Return the same mesh with nodes and cells in a random order, always the same one."""
    rng = np.random.default_rng(mesh.n_cells)
    nodes, cells = rng.permutation(mesh.n_points), rng.permutation(mesh.n_cells)
    number = np.argsort(nodes).astype(np.int32)
    facets = mesh.tagged_facets
    return SimplexMesh(
        mesh.points[nodes],
        number[mesh.cells[cells]],
        cell_tags=None if mesh.cell_tags is None else mesh.cell_tags[cells],
        tagged_facets=None if facets is None else number[facets],
        facet_tags=mesh.facet_tags,
        tag_names=mesh.tag_names,
    )
