"""The tags of the cells and facets of a mesh from a file, and their names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import (
    TAG_NAMES,
    UNTAGGED,
    RawMesh,
    Simplices,
    dimension_of,
    gather,
    simplices_of,
    tag_key,
)
from adaptsize.background.topology import (
    facets_of,
    regions_beside,
    tags_of_facets,
)
from adaptsize.errors import OptionError

#: The largest share of the facets that lie between two regions.
_SHARE_BETWEEN = 0.3
#: Fields of integers with several values that are no tags: owners in parallel runs.
_RANKS = re.compile(r"rank|proc|partition|ghost|level|colou?r", re.IGNORECASE)


class Tagged(NamedTuple):
    """Tags as a mesh holds them."""

    name: str | None
    """Of the cell field with the tags."""
    cell_tags: npt.NDArray[np.int32] | None
    facets: npt.NDArray[Any] | None
    facet_tags: npt.NDArray[np.int32] | None
    names: dict[tuple[int, int], str]

    @property
    def has_none(self) -> bool:
        """Whether neither cells nor facets have tags."""
        return self.cell_tags is None and self.facet_tags is None


def tagged(raw: RawMesh, simplices: Simplices, tags: str | None, notes: list[str]) -> Tagged:
    """Return the tags of the simplices, and tagged facets of them.

    Parameters
    ----------
    raw : RawMesh
    simplices : Simplices
    tags : str or None
        Name of the cell field with the tags; None selects the most likely one.
    notes : list of str
        In/Out.
    """
    dim = simplices.cells.shape[1] - 1
    _check_tags(raw, tags)
    name, cell_tags = _tags(raw, simplices, tags)
    facets, facet_tags, facet_name = _facets(raw, simplices, notes, tags)
    notes.extend(_dropped_groups(raw, dim))
    # Names belong to physical groups, not to geometric entities.
    named = {dim: name, dim - 1: facet_name}
    names = {
        key: title
        for key, title in raw.tag_names.items()
        if named.get(key[0], "gmsh:geometrical") not in (None, "gmsh:geometrical")
    }
    cell_tags, names = _without_untagged(cell_tags, names, dim)
    return Tagged(name, cell_tags, facets, facet_tags, names)


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


def unused(
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
