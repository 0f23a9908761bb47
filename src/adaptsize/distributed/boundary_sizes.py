"""Sizes from the curvature of the boundary, and from the local width, on distributed meshes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from adaptsize import sizes
from adaptsize._checks import as_angle, as_number, check_type
from adaptsize._defaults import CREASE_ANGLE
from adaptsize._progress import reporting
from adaptsize.background import SimplexMesh
from adaptsize.background.migration import interface_facets
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.background.topology import oriented_facets, tags_of_facets
from adaptsize.ranks import Ids
from adaptsize.sizes.combine import minimum
from adaptsize.sizes.feature import SMALLEST_SHARE, widths_in
from adaptsize.typing import FloatArray, IntArray, ProgressCallback


class _Boundary(NamedTuple):
    """The boundary of the whole domain, the same on all ranks."""

    mesh: SimplexMesh
    """Equal to that of `SimplexMesh.boundary` of the whole mesh."""
    ids: Ids
    """Global numbers of its nodes, ascending."""


def size_from_curvature(
    part: PartitionedMesh,
    *,
    elements_per_radian: float = 4.0,
    crease_angle: float = CREASE_ANGLE,
    smoothing: int = 0,
    hmin: float | None = None,
    hmax: float | None = None,
) -> FloatArray:
    """Return the size that resolves the curvature of the boundary; collective.

    The result equals that of `adaptsize.size_from_curvature` on the whole mesh, bit by bit.

    Parameters
    ----------
    part : PartitionedMesh
    elements_per_radian, crease_angle, smoothing, hmin, hmax
        As for `adaptsize.size_from_curvature`; the same on all ranks.

    Returns
    -------
    ndarray of float64, shape (n_local,)

    Raises
    ------
    ValueError
        On all ranks, if the input of any rank is bad.

    Notes
    -----
    All ranks have the whole boundary, and compute its curvature: four exchanges (two of them find
    the shared nodes) and one gather when a mesh is used for the first time, none later.  Surfaces
    and curves are collected on rank 0.

    Examples
    --------
    >>> angle = np.arange(8) * np.pi / 4
    >>> points = np.vstack([[0, 0], 2 * np.column_stack([np.cos(angle), np.sin(angle)])])
    >>> disk = SimplexMesh(points, [[0, i, i % 8 + 1] for i in range(1, 9)])
    >>> part = PartitionedMesh.from_serial(disk)
    >>> size_from_curvature(part, crease_angle=50.0).round(12)
    array([inf, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])
    """
    check_type("part", part, PartitionedMesh)

    def on(mesh: SimplexMesh) -> FloatArray:
        return sizes.size_from_curvature(
            mesh,
            elements_per_radian=elements_per_radian,
            crease_angle=crease_angle,
            smoothing=smoothing,
            hmin=hmin,
            hmax=hmax,
        )

    if part.cell_dim < part.dim or part.dim == 1:
        return _collected(part, on)
    boundary = _boundary_of(part)
    at_boundary = part.ranks.agree(lambda: on(boundary.mesh))
    row = np.minimum(np.searchsorted(boundary.ids, part.global_ids), len(boundary.ids) - 1)
    h0 = np.where(boundary.ids[row] == part.global_ids, at_boundary[row], np.inf)
    return minimum(h0, hmin=hmin, hmax=hmax)


def size_from_feature(
    part: PartitionedMesh,
    *,
    elements_across: float = 4.0,
    crease_angle: float = CREASE_ANGLE,
    corner_angle: float = 30.0,
    hmin: float | None = None,
    hmax: float | None = None,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray:
    """Return the size that puts a number of elements across narrow regions; collective.

    The result equals that of `adaptsize.size_from_feature` on the whole mesh, with the method
    ``"rays"``, bit by bit.

    Parameters
    ----------
    part : PartitionedMesh
    elements_across, crease_angle, corner_angle, hmin, hmax, progress
        As for `adaptsize.size_from_feature`.  Only the values on rank 0 are used.

    Returns
    -------
    ndarray of float64, shape (n_local,)

    Raises
    ------
    ValueError
        On all ranks, if the input is bad.

    Notes
    -----
    The nodes, without cells, are collected on rank 0, which shoots all rays.

    Examples
    --------
    >>> plate = SimplexMesh([[0, 0], [10, 0], [10, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> size_from_feature(PartitionedMesh.from_serial(plate), elements_across=5)
    array([0.2, 0.2, 0.2, 0.2])
    """
    check_type("part", part, PartitionedMesh)

    def on(mesh: SimplexMesh) -> FloatArray:
        return sizes.size_from_feature(
            mesh,
            elements_across=elements_across,
            crease_angle=crease_angle,
            corner_angle=corner_angle,
            hmin=hmin,
            hmax=hmax,
            progress=progress,
        )

    if part.cell_dim < part.dim or part.dim == 1:
        return _collected(part, on)
    boundary = _boundary_of(part)
    in_cell = np.zeros(part.n_points)
    in_cell[part.cells] = 1.0
    points, used = part.gather_nodal(part.points), part.gather_nodal(part.maximum(in_cell))

    def solve() -> FloatArray | None:
        if points is None or used is None:
            return None
        across = as_number("elements_across", elements_across, lower=0.0, strict=True)
        angles = as_angle("crease_angle", crease_angle), as_angle("corner_angle", corner_angle)
        row = np.full(len(points), -1, np.int32)
        row[boundary.ids] = np.arange(len(boundary.ids))
        with reporting(progress) as report:
            widths = widths_in(boundary.mesh, points, row, used > 0.0, *angles, report)
        smallest = SMALLEST_SHARE * boundary.mesh.diameter
        return minimum(np.maximum(widths / across, smallest), hmin=hmin, hmax=hmax)

    return part.scatter_nodal(part.ranks.agree(solve))


def _collected(part: PartitionedMesh, function: Callable[[SimplexMesh], FloatArray]) -> FloatArray:
    """Return the sizes that rank 0 computes on the whole mesh; collective."""
    whole = part.gather()
    return part.scatter_nodal(part.ranks.agree(lambda: None if whole is None else function(whole)))


def _boundary_of(part: PartitionedMesh) -> _Boundary:
    """Return the boundary of the whole mesh; collective on first use."""
    return part.once("_whole_boundary", lambda: _find_boundary(part))


def _find_boundary(part: PartitionedMesh) -> _Boundary:
    own = _own_facets(part, interface_facets(part))
    nodes = np.unique(own[2])
    sent = (*own[:2], part.global_ids[own[2]], own[3], part.global_ids[nodes], part.points[nodes])
    every = part.ranks.allgather((*sent, None if part.mesh is None else dict(part.mesh.tag_names)))
    cell, opposite, facets, tags, ids, points = (
        np.concatenate([found[column] for found in every]) for column in range(6)
    )
    if len(facets) == 0:
        raise ValueError("the mesh is closed: it has no boundary")
    order = np.lexsort([opposite, cell])  # as in the whole mesh
    ids, at = np.unique(ids, return_index=True)
    names = next((found[6] for found in every if found[6] is not None), None)
    mesh = SimplexMesh(
        points[at],
        np.searchsorted(ids, facets[order]),
        cell_tags=tags[order] if (tags >= 0).any() else None,
        tag_names=names,
    )
    return _Boundary(mesh, ids)


def _own_facets(
    part: PartitionedMesh, between: IntArray
) -> tuple[Ids, IntArray, IntArray, IntArray]:
    """Return the facets of the boundary on this rank, without those between parts.

    Returns
    -------
    cell, opposite : int[f]
        Global numbers of their cells, and the vertices that are not in the facet.
    facets : int32[f, dim]
        Local nodes, normals outward.
    tags : int32[f]
        0 for none; -1 if no facets are tagged.
    """
    mesh = part.mesh
    if mesh is None:
        none = np.empty(0, np.int32)
        return np.empty(0, np.int64), none, np.empty((0, part.dim), np.int32), none
    inner = np.zeros(len(mesh.facets), np.int32)
    if len(between):
        inner = tags_of_facets(mesh.facets, between, np.ones(len(between), np.int32), mesh.n_points)
    free = (mesh.facet_cell_counts == 1) & (inner == 0)
    cell, opposite = np.nonzero(free[mesh.cell_facets])
    inverted = mesh.signed_measures[cell] < 0.0
    facets = oriented_facets(mesh.cells[cell], opposite, inverted)
    tags = np.full(len(cell), -1, np.int32)
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        every = tags_of_facets(mesh.facets, mesh.tagged_facets, mesh.facet_tags, mesh.n_points)
        tags = every[mesh.cell_facets[cell, opposite]]
    return part.cell_ids[cell], opposite.astype(np.int32), facets, tags
