"""Conversion of the content of a file to a SimplexMesh: choice of cells and fields."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import (
    KINDS,
    TAG_NAMES,
    RawMesh,
    Simplices,
    dimension_of,
    gather,
    plural,
    simplices_of,
    tag_key,
)
from adaptsize._formats.joining import joined_if_most_are_double, means
from adaptsize._formats.tagging import tagged, unused
from adaptsize._messages import Message
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import (
    have_different_nodes,
    unique_rows,
)
from adaptsize.errors import MeshFileError

#: Differences of third coordinates, over the size of the mesh, that are rounding.
_ROUNDING = 1e-8


def _wanted_dimension(raw: RawMesh, kind: str | None) -> int:
    present = {dimension_of(cell_type) for cell_type, cells in raw.blocks if len(cells)}
    dim = max(present) if kind is None else KINDS[kind]
    if dim not in present or dim == 0:
        found = ", ".join(f"{len(c)} {plural(t)}" for t, c in raw.blocks if len(c))
        raise MeshFileError(f"holds no {kind or 'cells but points'} (found {found})")
    return dim


def build(
    raw: RawMesh,
    *,
    kind: str | None,
    flatten: bool,
    notes: list[str],
    tags: str | None = None,
    errors: Sequence[str] = (),
    keep_slits: bool = True,
) -> SimplexMesh:
    """Return the simplices with their tags and fields.  Repairs are appended to ``notes``.

    Parameters
    ----------
    raw : RawMesh
    kind : {"tetrahedra", "triangles", "segments"} or None
        Which cells to take.  None selects those of the highest dimension.
    flatten : bool
        Whether triangles and segments with z = 0 become a mesh in the plane.
    notes : list of str
        In/Out.
    tags : str, optional
        Name of the cell field with the tags.
    errors : sequence of str
        Cell fields with errors, which the parts of a cell share.
    keep_slits : bool
        Whether nodes at one place stay different if most facets are double.
    """
    raw, simplices, axes = _cells_of(raw, kind, notes, flatten=flatten, keep_slits=keep_slits)
    own = tagged(raw, simplices, tags, notes)
    cell_data = _cell_fields(raw, simplices, own.name)
    if own.has_none and tags is None:
        notes.extend(unused(cell_data, simplices.cells, len(raw.points)))
    cells, facets = simplices.cells, own.facets
    keep = _kept_nodes(raw, cells, reduced=kind is not None or bool(simplices.notes))
    if not keep.all():
        number = np.cumsum(keep) - 1
        cells = number[cells]
        facets = None if facets is None else number[facets]
    mesh = SimplexMesh(
        raw.points[keep][:, axes],
        cells,
        cell_tags=own.cell_tags,
        tagged_facets=facets,
        facet_tags=own.facet_tags,
        tag_names=own.names,
        point_data={name: values[keep] for name, values in _nodal_fields(raw).items()},
        cell_data=cell_data,
    )
    parent = _parents(simplices)
    shared = {name: _shares(mesh, parent, name) for name in errors if name in mesh.cell_data}
    return mesh.with_data(cell_data=shared) if shared else mesh


def _cells_of(
    raw: RawMesh, kind: str | None, notes: list[str], *, flatten: bool, keep_slits: bool
) -> tuple[RawMesh, Simplices, list[int]]:
    """Return the cells to take, the mesh that they are of, and the axes of its coordinates."""
    dim = _wanted_dimension(raw, kind)
    simplices = simplices_of(raw, dim)
    if not keep_slits and dim > 1:
        connected = _connected(raw, simplices, notes)
        if connected is not raw:  # now the simplices of neighbours match
            raw, simplices = connected, simplices_of(connected, dim)
    simplices = _without_repeated_nodes(simplices, notes)
    axes = [*range(raw.points.shape[1])]
    if flatten and dim < 3 and len(axes) == 3:
        only_at_0 = raw.is_surface or dim == 1
        axes = _axes(raw.points, simplices.cells, notes, only_at_0=only_at_0)
    if dim == len(axes):  # the cells fill the space
        simplices = _without_repeated_cells(simplices, notes)
    return raw, simplices, axes


def _connected(raw: RawMesh, simplices: Simplices, notes: list[str]) -> RawMesh:
    """Return the mesh with nodes at one place joined, if most facets are double."""
    fills_space = simplices.cells.shape[1] > raw.points.shape[1]
    if not fills_space and simplices.cells.shape[1] == 3:
        axes = _axes(raw.points, simplices.cells, [], only_at_0=False)
        fills_space = len(axes) == 2
    if raw.is_surface or not fills_space:
        return raw
    joined = joined_if_most_are_double(raw.points, simplices.cells, _parents(simplices))
    if joined is None:
        return raw
    n = len(joined.points)
    text = (
        "most facets are double: nodes at one place joined, {} become {}, with the mean of nodal "
        "fields; {keep_slits:True} keeps them apart"
    )
    notes.append(Message(text, len(raw.points), n))
    blocks = [
        (name, cells if cells.dtype == object else joined.number[cells])
        for name, cells in raw.blocks
    ]
    fields = {
        name: means(np.asarray(values), joined.number, n)
        for name, values in raw.point_data.items()
        if len(values) == len(raw.points) and np.asarray(values).dtype.kind in "biuf"
    }
    return replace(raw, points=joined.points, blocks=blocks, point_data=fields)


def _parents(simplices: Simplices) -> npt.NDArray[np.int64]:
    """Return a number of the cell of the file for each simplex."""
    pairs = np.stack([simplices.block, simplices.row], axis=1)
    is_next = np.concatenate([[True], (pairs[1:] != pairs[:-1]).any(axis=1)])
    return np.asarray(np.cumsum(is_next) - 1)


def _shares(mesh: SimplexMesh, parent: npt.NDArray[np.int64], name: str) -> npt.NDArray[Any]:
    """Return the errors of simplices whose squares add up to that of their cell of the file."""
    values = np.asarray(mesh.cell_data[name], np.float64)
    whole = np.bincount(parent, weights=mesh.measures)[parent]
    alike = 1.0 / np.bincount(parent)[parent]
    share = np.divide(mesh.measures, whole, out=alike, where=whole > 0.0)
    shared: npt.NDArray[Any] = values * np.sqrt(share).reshape(-1, *[1] * (values.ndim - 1))
    return shared


def _axes(
    points: npt.NDArray[Any], cells: npt.NDArray[Any], notes: list[str], *, only_at_0: bool
) -> list[int]:
    """Return the axes of the plane in which all cells lie up to rounding, or all three.

    Surfaces and lines in space may be flat elsewhere than at z = 0, and stay.
    """
    used = points[np.unique(cells)]
    low, high = used.min(axis=0), used.max(axis=0)
    for normal in (2,) if only_at_0 else (2, 1, 0):
        axes = [axis for axis in range(3) if axis != normal]
        with np.errstate(over="ignore", invalid="ignore"):  # coordinates are checked later
            extent = high - low
            if not extent[normal] <= _ROUNDING * np.hypot(*extent[axes]):
                continue
        if max(abs(low[normal]), abs(high[normal])) > extent[normal] or normal < 2:
            if only_at_0:
                continue
            plane = f"the {'xyz'[axes[0]]}-{'xyz'[axes[1]]} plane" if normal < 2 else "the plane"
            notes.append(
                f"taken as a mesh in {plane}: {'xyz'[normal]} is "
                f"{0.5 * (low[normal] + high[normal]):g} everywhere (flatten=False keeps it)"
            )
        return axes
    return [0, 1, 2]


def _without_repeated_cells(simplices: Simplices, notes: list[str]) -> Simplices:
    """Drop cells that have the same nodes as another."""
    rows = np.sort(simplices.cells, axis=1).astype(np.int32)
    number = unique_rows(rows, int(rows.max()) + 1)[1]
    first = np.zeros(len(rows), bool)
    first[np.unique(number, return_index=True)[1]] = True
    if first.all():
        return simplices
    notes.append(f"{np.count_nonzero(~first)} cells with the same nodes as another dropped")
    cells, block, row = (rows[first] for rows in simplices[:3])
    return Simplices(cells, block, row, simplices.notes)


def _without_repeated_nodes(simplices: Simplices, notes: list[str]) -> Simplices:
    """Drop cells that contain a node twice.  All changes to cells are appended to ``notes``."""
    good = have_different_nodes(simplices.cells)
    if not good.any():
        raise MeshFileError("holds only cells that contain a node twice")
    if not good.all():
        dropped = f"{np.count_nonzero(~good)} cells that contain a node twice dropped"
        cells, block, row = (rows[good] for rows in simplices[:3])
        simplices = Simplices(cells, block, row, [*simplices.notes, dropped])
    notes.extend(simplices.notes)
    return simplices


def _kept_nodes(raw: RawMesh, cells: npt.NDArray[Any], *, reduced: bool) -> npt.NDArray[np.bool_]:
    """Return the nodes to keep: all except those that only belong to omitted cells."""
    keep = np.ones(len(raw.points), bool)
    if reduced:
        for _, found in raw.blocks:
            if found.dtype != object:
                keep[found] = False
        keep[cells] = True
    return keep


def _cell_fields(
    raw: RawMesh, simplices: Simplices, tag_name: str | None
) -> dict[str, npt.NDArray[Any]]:
    """Return the numeric cell data, except the tags and tags that are all 0."""
    fields = {}
    for name, blocks in raw.cell_data.items():
        values = gather(blocks, simplices)
        if name in (tag_name, "obj:group_ids") or values is None:
            continue
        if values.dtype.kind in "biuf" and (tag_key(name) not in TAG_NAMES or values.any()):
            fields[name] = _native(values)
    return fields


def _nodal_fields(raw: RawMesh) -> dict[str, npt.NDArray[Any]]:
    """Return the numeric point data with one row per node that carry information."""
    fields = {}
    for name, values in raw.point_data.items():
        array = np.asarray(values)
        fits = array.ndim > 0 and len(array) == len(raw.points) and array.dtype.kind in "biuf"
        # Gmsh's entity numbers, and the references 0 that each Medit file has.
        empty = name == "gmsh:dim_tags" or (name == "medit:ref" and not array.any())
        if fits and not empty:
            fields[name] = _native(array)
    return fields


def _native(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the array in native byte order.  Legacy VTK files are big-endian."""
    return array.astype(array.dtype.newbyteorder("="), copy=False)
