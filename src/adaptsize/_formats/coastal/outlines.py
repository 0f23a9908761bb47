"""Lines in the plane that are rings together, and the refusal of those that are not."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adaptsize._checks import check_range, place_text
from adaptsize.background.merging import place_numbers
from adaptsize.typing import FloatArray, IndexArray, IntArray

#: Lines closer than this times the diagonal touch: cells between them would be flat.
_CONTACT = 1e-9


class Line(NamedTuple):
    """A ring, or a part of one."""

    points: FloatArray
    """float64[n, 2]"""
    name: str | None
    """Of this part of the boundary."""
    source: str
    """Where it comes from, for messages."""
    closes: bool = True
    """Whether it is a polygon, whose ends are joined."""
    is_hole: bool = False
    """Whether it must lie inside another ring."""


class Outline(NamedTuple):
    """Segments of rings: each node has two of them."""

    points: FloatArray
    """float64[n, 2]"""
    segments: IndexArray
    """int[m, 2]"""
    line: IndexArray
    """int[m]: the line that each is a part of."""
    tags: IntArray
    """int32[m]: 0 without a name."""
    contact: float = 0.0
    """Distance up to which lines touch."""


def outline_of(lines: Sequence[Line], names: list[str], notes: list[str]) -> Outline:
    """Return the segments of all lines, and refuse what are not rings."""
    if not lines:
        raise ValueError("outer must have at least one polygon, got none")
    given = np.concatenate([line.points for line in lines])
    check_range("points", given)
    contact = _contact(given)
    number = place_numbers(given, contact)
    points = given[np.unique(number, return_index=True)[1]]
    nodes = np.split(number, np.cumsum([len(line.points) for line in lines])[:-1])
    nodes = _without_repeated(points, nodes, notes)
    for k, (own, line) in enumerate(zip(nodes, lines, strict=True)):
        if line.closes and own[0] != own[-1]:
            nodes[k] = np.append(own, own[0])
        if len(np.unique(own)) < (3 if nodes[k][0] == nodes[k][-1] else 2):
            place = place_text(points[own[0]])
            raise ValueError(f"{line.source} must have 3 different points or more, near {place}")
    segments = np.concatenate([np.column_stack([own[:-1], own[1:]]) for own in nodes])
    line_of = np.repeat(np.arange(len(lines)), [len(own) - 1 for own in nodes])
    key = np.sort(segments, axis=1) @ np.array([len(points), 1])
    is_ring = np.array([own[0] == own[-1] for own in nodes])
    is_polygon = np.array([line.closes for line in lines])
    # Lines along a ring, or along a whole polygon, have no other purpose than to name it.
    on_ring, on_polygon = (np.isin(key, key[base[line_of]]) for base in (is_ring, is_polygon))
    off = ~np.where(is_ring[line_of], on_polygon, on_ring)
    is_label = ~is_polygon & (np.bincount(line_of, off, len(lines)) == 0)
    kept = ~is_label[line_of]
    tag_of_line = np.array([0 if n.name is None else names.index(n.name) + 1 for n in lines])
    tags = tag_of_line[line_of].astype(np.int32)
    order = np.argsort(key[kept], kind="stable")
    at = np.searchsorted(key[kept], key[~kept], sorter=order)
    rows = np.flatnonzero(kept)
    tags[rows[order[at]]] = tags[~kept]
    outline = Outline(points, segments[kept], line_of[kept], tags[kept], contact)
    _refuse_repeated(outline, key[kept], lines)
    _refuse_open(outline, lines)
    return outline


def _contact(points: FloatArray) -> float:
    """Return the distance up to which points coincide: of the size, or rounding far from 0."""
    low, high = points.min(axis=0), points.max(axis=0)
    rounding = 4.0 * float(np.spacing(np.abs(points).max()))
    return max(_CONTACT * float(np.linalg.norm(high - low)), rounding)


def _without_repeated(
    points: FloatArray, nodes: Sequence[IndexArray], notes: list[str]
) -> list[IndexArray]:
    """Return the nodes of each line without those that repeat the one before."""
    keep = [np.append(True, own[1:] != own[:-1]) for own in nodes]
    first = next((own[~k][0] for own, k in zip(nodes, keep, strict=True) if not k.all()), None)
    if first is not None:
        count = sum(int((~k).sum()) for k in keep)
        place = place_text(points[first])
        notes.append(f"{count} points that repeat the one before merged, the first at {place}")
    return [own[k] for own, k in zip(nodes, keep, strict=True)]


def _refuse_repeated(outline: Outline, key: IndexArray, lines: Sequence[Line]) -> None:
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    if (count == 1).all():
        return
    e = first[count > 1].min()
    pair = np.flatnonzero(key == key[e])[:2]
    a, b = (place_text(outline.points[node]) for node in outline.segments[e])
    one, other = (lines[k].source for k in outline.line[pair])
    who = f"{one} runs twice" if one == other else f"{one} and {other} both run"
    raise ValueError(f"{who} between {a} and {b}; rings must not touch")


def _refuse_open(outline: Outline, lines: Sequence[Line]) -> None:
    """Raise a ValueError unless each node has two segments."""
    degree = np.bincount(outline.segments.ravel(), minlength=len(outline.points))
    touching = np.flatnonzero(degree > 2)
    if len(touching):
        at = outline.line[(outline.segments == touching[0]).any(axis=1)]
        who = " and ".join(dict.fromkeys(lines[k].source for k in at))
        who = who if " and " in who else f"parts of {who}"
        raise ValueError(f"{who} touch at {place_text(outline.points[touching[0]])}")
    dangling = np.flatnonzero(degree == 1)
    if not len(dangling):
        return
    end = outline.points[dangling[0]]
    source = lines[outline.line[(outline.segments == dangling[0]).any(axis=1)][0]].source
    gaps = np.linalg.norm(outline.points[dangling[1:]] - end, axis=1)
    k = int(np.argmin(gaps))
    raise ValueError(
        f"{source} is open: it ends at {place_text(end)}, where no other line begins; the nearest "
        f"open end is at {place_text(outline.points[dangling[k + 1]])}, {gaps[k]:.3g} away"
    )


def refuse_crossings(outline: Outline, lines: Sequence[Line]) -> None:
    """Raise a ValueError if segments cross, or come closer than contact away from common ends."""
    import shapely

    ends = outline.segments
    segments = shapely.linestrings(outline.points[ends])
    tree = shapely.STRtree(segments)
    one, other = tree.query(segments, predicate="dwithin", distance=outline.contact)
    one, other = one[one < other], other[one < other]
    shared = (ends[one][:, :, None] == ends[other][:, None, :]).any(axis=2)
    # Neighbours have a node in common; they overlap if the far end of one is on the other.
    bad = np.flatnonzero(~shared.any(axis=1))
    beside = np.flatnonzero(shared.any(axis=1))
    common = ends[one[beside]][shared[beside]]
    folds = np.zeros(len(beside), bool)
    for own, its in ((one, other), (other, one)):
        far = outline.points[ends[own[beside]].sum(axis=1) - common]
        away = shapely.distance(shapely.points(far), segments[its[beside]])
        folds |= away <= outline.contact
    bad = np.concatenate([bad, beside[folds]])
    if not len(bad):
        return
    first = bad[np.argmin(one[bad])]
    pair = segments[[one[first], other[first]]]
    a, b = (lines[outline.line[k[first]]].source for k in (one, other))
    more = f" (and {len(bad) - 1} more places)" if len(bad) > 1 else ""
    gap, meeting = shapely.distance(*pair), shapely.intersection(*pair)
    if not shapely.is_empty(meeting):
        place = place_text(shapely.get_coordinates(meeting)[0])
        who = f"{a} crosses or touches itself" if a == b else f"{a} and {b} cross or touch"
        raise ValueError(f"{who} at {place}{more}")
    place = place_text(shapely.get_coordinates(shapely.shortest_line(*pair))[0])
    who = f"parts of {a}" if a == b else f"{a} and {b}"
    raise ValueError(
        f"{who} touch at {place}{more}: they are {gap:.2g} apart, where cells would be flat; at "
        f"least {outline.contact:.2g} is required"
    )


def rings_of(segments: IndexArray) -> list[IndexArray]:
    """Return the rings: int[k, 2] with the nodes in order and the segment after each."""
    at = (np.argsort(segments.ravel(), kind="stable") // 2).reshape(-1, 2).tolist()
    ends, free = segments.tolist(), [True] * len(segments)
    rings = []
    for first in range(len(ends)):
        ring, edge, node = [], first, ends[first][0]
        while free[edge]:
            free[edge] = False
            ring.append((node, edge))
            node = sum(ends[edge]) - node
            edge = sum(at[node]) - edge
        if ring:
            rings.append(np.array(ring))
    return rings
