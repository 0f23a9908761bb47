"""Conversion of the content of a file to a SimplexMesh: choice of cells, tags and fields."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import (
    KINDS,
    TAG_NAMES,
    UNTAGGED,
    RawMesh,
    Simplices,
    dimension_of,
    gather,
    plural,
    simplices_of,
    tag_key,
)
from adaptsize._formats.joining import joined_if_most_are_double, means
from adaptsize._messages import Message
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import (
    facets_of,
    have_different_nodes,
    regions_beside,
    tags_of_facets,
    unique_rows,
)
from adaptsize.errors import MeshFileError, OptionError

#: The largest share of the facets that lie between two regions.
_SHARE_BETWEEN = 0.3
#: Differences of third coordinates, over the size of the mesh, that are rounding.
_ROUNDING = 1e-8
#: Fields of integers with several values that are no tags: owners in parallel runs.
_RANKS = re.compile(r"rank|proc|partition|ghost|level|colou?r", re.IGNORECASE)


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
    fills_space = dim == len(axes)
    if fills_space:
        simplices = _without_repeated_cells(simplices, notes)
    _check_tags(raw, tags)
    tag_name, cell_tags = _tags(raw, simplices, tags)
    facets, facet_tags, facet_tag_name = _facets(raw, simplices, notes, tags)
    notes.extend(_dropped_groups(raw, dim))
    # Names belong to physical groups, not to geometric entities.
    named = {dim: tag_name, dim - 1: facet_tag_name}
    names = {
        key: name
        for key, name in raw.tag_names.items()
        if named.get(key[0], "gmsh:geometrical") not in (None, "gmsh:geometrical")
    }
    cell_tags, names = _without_untagged(cell_tags, names, dim)
    cell_data = _cell_fields(raw, simplices, tag_name)
    if cell_tags is None and facet_tags is None and tags is None:
        notes.extend(_unused(cell_data, simplices.cells, len(raw.points)))
    cells = simplices.cells
    keep = _kept_nodes(raw, cells, reduced=kind is not None or bool(simplices.notes))
    if not keep.all():
        number = np.cumsum(keep) - 1
        cells = number[cells]
        facets = None if facets is None else number[facets]
    points = raw.points[keep][:, axes]
    point_data = {name: values[keep] for name, values in _nodal_fields(raw).items()}
    mesh = SimplexMesh(
        points,
        cells,
        cell_tags=cell_tags,
        tagged_facets=facets,
        facet_tags=facet_tags,
        tag_names=names,
        point_data=point_data,
        cell_data=cell_data,
    )
    parent = _parents(simplices)
    shared = {name: _shares(mesh, parent, name) for name in errors if name in mesh.cell_data}
    return mesh.with_data(cell_data=shared) if shared else mesh


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


def _dropped_groups(raw: RawMesh, dim: int) -> list[str]:
    """Return notes on the tagged nodes and segments that a mesh of cells cannot hold."""
    by_name = {name.lower(): name for name in raw.cell_data}
    names = (name for name in TAG_NAMES if name in by_name and name != "gmsh:geometrical")
    fields = [raw.cell_data[by_name[name]] for name in names]
    notes = []
    for lower in range(dim - 1):
        of_dim = [i for i, (name, _) in enumerate(raw.blocks) if dimension_of(name) == lower]
        tags = np.concatenate([np.zeros(0), *(_first_tags(fields, i) for i in of_dim)])
        tags = tags[tags != 0]
        if len(tags):
            found = np.unique(tags)
            held = [raw.tag_names.get((lower, int(tag)), f"{tag:g}") for tag in found[:5]]
            text = ", ".join(held) + ", ..." * (len(found) > 5)
            notes.append(f"{len(tags)} tagged {('nodes', 'segments')[lower]} dropped ({text})")
    return notes


def _first_tags(
    fields: Sequence[Sequence[npt.NDArray[Any]]], block: int
) -> npt.NDArray[np.float64]:
    """Return the tags of a block in the first field that has some."""
    for blocks in fields:
        values = np.asarray(blocks[block])
        if values.ndim == 1 and values.dtype.kind in "iuf" and values.any():
            return values.astype(np.float64)
    return np.zeros(0)


def _without_untagged(
    cell_tags: npt.NDArray[np.int32] | None, names: dict[tuple[int, int], str], dim: int
) -> tuple[npt.NDArray[np.int32] | None, dict[tuple[int, int], str]]:
    """Return tags and names without the group for untagged cells."""
    group = next((key for key, name in names.items() if name == UNTAGGED and key[0] == dim), None)
    if group is None or cell_tags is None:
        return cell_tags, names
    tags = np.where(cell_tags == group[1], 0, cell_tags).astype(np.int32)
    others = {key: name for key, name in names.items() if key != group}
    return (tags if tags.any() else None), others


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


def _check_tags(raw: RawMesh, name: str | None) -> None:
    """Refuse a name of tags that no cell field has; the message lists those of integers."""
    if name is None or name in raw.cell_data:
        return
    listed = [
        field
        for field, parts in raw.cell_data.items()
        if all(np.asarray(part).dtype.kind in "iu" for part in parts)
    ]
    found = f"integer cell fields: {', '.join(listed)}" if listed else "it has none of integers"
    raise OptionError(f"has no cell field {name!r} for tags ({found})", ["tags"])


def _unused(
    cell_data: Mapping[str, npt.NDArray[Any]], cells: npt.NDArray[np.int64], n_points: int
) -> Iterator[str]:
    """Yield a note on integer fields that may be tags: cells of a value lie side by side."""
    candidates = {
        name: values.reshape(-1)
        for name, values in cell_data.items()
        if values.dtype.kind in "iu" and values.size == len(values) and not _RANKS.search(name)
        if 1 < len(np.unique(values)) <= len(values) / 4
    }
    if not candidates:
        return
    facets, of_cells = facets_of(cells.astype(np.int32), n_points)
    names = []
    for name, values in candidates.items():
        regions = np.unique(values, return_inverse=True)[1].reshape(-1)
        low, high = regions_beside(of_cells, regions.astype(np.int32), len(facets))
        inner = np.bincount(of_cells.ravel(), minlength=len(facets)) > 1
        if np.count_nonzero((low != high)[inner]) <= _SHARE_BETWEEN * np.count_nonzero(inner):
            names.append(repr(name))
    if names:
        yield (
            f"no field has a name that is known for tags; the integer fields {', '.join(names)} "
            "may be some (tags=NAME of read, --tags NAME)"
        )


def _tags(
    raw: RawMesh, simplices: Simplices, name: str | None
) -> tuple[str | None, npt.NDArray[np.int32] | None]:
    """Return the tags of the simplices and the name of their field, the most likely by default."""
    by_name = {tag_key(found): found for found in reversed([*raw.cell_data])}
    wanted_names = [name] if name is not None else [by_name.get(key) for key in TAG_NAMES]
    for wanted in wanted_names:
        if wanted is None or not len(simplices.cells):
            continue
        values = gather(raw.cell_data[wanted], simplices)
        if values is None or values.size != len(values) or values.dtype.kind not in "iuf":
            continue
        values = values.reshape(-1)
        integer = np.isfinite(values).all() and (values == np.floor(values)).all()
        if integer and values.any() and np.abs(values).max() < 2**31:
            return wanted, values.astype(np.int32)
    return None, None


def _facets(
    raw: RawMesh, simplices: Simplices, notes: list[str], tags_from: str | None
) -> tuple[npt.NDArray[Any] | None, npt.NDArray[np.int32] | None, str | None]:
    """Return the tagged cells of one dimension less that are facets, and their tag field."""
    dim = simplices.cells.shape[1] - 1
    if not any(dimension_of(t) == dim - 1 and len(c) for t, c in raw.blocks) or dim == 1:
        return None, None, None
    found = simplices_of(raw, dim - 1)
    name, tags = _tags(raw, found, tags_from)
    if tags is None:
        return None, None, None
    n_points = len(raw.points)
    facets = facets_of(simplices.cells.astype(np.int32), n_points)[0]
    known = np.ones(len(facets), np.int32)
    good = tags_of_facets(found.cells.astype(np.int32), facets, known, n_points) == 1
    if not good.all():
        notes.append(f"{np.count_nonzero(~good)} tagged facets that bound no cell dropped")
    if not good.any():
        return None, None, None
    return found.cells[good], tags[good], name
