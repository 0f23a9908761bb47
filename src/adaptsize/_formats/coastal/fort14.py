"""ADCIRC's fort.14 and SCHISM's hgrid.gr3: triangles in the plane with a depth at each node."""

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import warn_caller
from adaptsize._formats.blocks import RawMesh
from adaptsize._formats.text import check_last_number, numbers, rows_of, write_text
from adaptsize.background import SimplexMesh
from adaptsize.errors import InputWarning, MeshFileError

#: The nodal field that the third column holds.
DEPTH = "depth"
#: Words in the names of open boundaries.
_OPEN = re.compile(r"\b(open|ocean)\b", re.IGNORECASE)
#: Types of boundaries without flow: of the mainland, and of islands, whose lists are not closed.
_MAINLAND, _ISLANDS = 0, (1, 11, 21)
#: Names of further types, by the last digit.  A list of a weir has a pair of nodes in each line.
_OTHERS = {2: "river", 3: "barrier", 4: "weir", 5: "weir"}
_RIVER, _RIVERS = 22, re.compile(r"\b(river|inflow|discharge)\b", re.IGNORECASE)
_BARRIERS = re.compile(r"\b(weir|barrier|levee)s?\b", re.IGNORECASE)


def read(path: Path) -> RawMesh:
    """Return the triangles, the depth, and the open and land boundaries as tagged edges.

    Raises
    ------
    MeshFileError
        If the file is damaged, or ends before the counts in its header are reached.
    """
    content = path.read_bytes()
    lines = content.splitlines()
    if len(lines) < 2:
        raise MeshFileError("is truncated (the second line must hold two counts)")
    counts = lines[1].split()[:2]
    if len(counts) < 2 or not all(word.isdigit() for word in counts):
        raise MeshFileError("cannot be read as a mesh (the second line must hold two counts)")
    n_cells, n_points = int(counts[0]), int(counts[1])
    rows = [line.split() for line in lines[2 : 2 + n_points + n_cells]]
    if len(rows) < n_points + n_cells:
        raise MeshFileError(
            f"is truncated (promises {n_points} nodes and {n_cells} elements, holds {len(rows)})"
        )
    if len(lines) == 2 + n_points + n_cells:  # the lists of boundaries are missing
        check_last_number(content)
    points = _columns(rows[:n_points], 4, np.float64)
    cells = _columns(rows[n_points:], 5, np.int64)
    if (cells[:, 1] != 3).any():
        raise MeshFileError("holds elements that are no triangles, which cannot be read")
    names = points[:, 0]
    place = rows_of(cells[:, 2:], names, "an element")
    raw = RawMesh(points[:, 1:3], [("triangle", place)], {DEPTH: points[:, 3]})
    _add_boundaries(raw, lines[2 + n_points + n_cells :], names)
    return raw


def _add_boundaries(raw: RawMesh, lines: Sequence[bytes], names: npt.NDArray[Any]) -> None:
    """Add the lists of boundaries to a mesh, or a note if they are damaged."""
    try:
        found = list(_lists(iter(lines)))
    except (ValueError, IndexError, StopIteration, RuntimeError):
        if any(line.strip() for line in lines):
            raw.notes.append("the lists of boundaries cannot be read and are left out")
        return
    found = [(name, nodes) for name, nodes in found if len(nodes) > 1]
    if not found:
        return
    labels = sorted({name for name, _ in found})
    edges = np.array([pair for _, nodes in found for pair in pairwise(nodes)])
    tags = np.repeat(
        [labels.index(name) + 1 for name, _ in found], [len(nodes) - 1 for _, nodes in found]
    )
    raw.blocks.append(("line", rows_of(edges, names, "a boundary")))
    raw.cell_data = {"cell_tags": [np.zeros(len(raw.blocks[0][1]), np.int32), tags]}
    raw.tag_names = {(1, k + 1): name for k, name in enumerate(labels)}


def _lists(lines: Iterator[bytes]) -> Iterator[tuple[str, list[int]]]:
    """Yield the name and the nodes of each boundary, closed if it is that of an island.

    Of a weir, both sides are yielded.
    """
    for kind in ("open", "land"):
        n_lists = int(next(lines).split()[0])
        next(lines)  # the number of nodes in all
        for _ in range(n_lists):
            head, _, comment = next(lines).partition(b"=")
            words = head.split()
            number = int(words[1]) if kind == "land" and len(words) > 1 else _MAINLAND
            rows = [next(lines).split() for _ in range(int(words[0]))]
            nodes = [int(row[0]) for row in rows]
            is_island = number in _ISLANDS
            if is_island and nodes and nodes[0] != nodes[-1]:
                nodes.append(nodes[0])
            default = "island" if is_island else _OTHERS.get(number % 10, kind)
            name = comment.decode("utf-8", "replace").partition(":")[2].strip() or default
            yield name, nodes
            if default == "weir":
                yield name, [int(row[1]) for row in rows]


def _columns(rows: list[list[bytes]], count: int, dtype: type) -> npt.NDArray[Any]:
    short = next((row for row in rows if len(row) < count), None)
    if short is not None:
        raise MeshFileError(f"has a line with {len(short)} numbers, where {count} are required")
    found = numbers([word for row in rows for word in row[:count]], dtype)
    return found.reshape(-1, count)


def write(path: Path, mesh: SimplexMesh) -> None:
    """Write triangles in the plane with the nodal field ``depth``, or 0 without it.

    If there are tagged facets, all edges of the boundary are in the lists at the end.  Those with
    the word "open" or "ocean" in the name of their tag are open.  Those with "river", "inflow" or
    "discharge" are of type 22.  The others are land, of type 0, or 1 around islands.

    Raises
    ------
    ValueError
        If the depth is not one number per node, or a name has the word "weir", "barrier" or
        "levee": these have heights, which a mesh does not hold.

    Warns
    -----
    InputWarning
        If there is no depth, or no tagged facet.
    """
    _check_named(mesh)
    depth = np.asarray(mesh.point_data.get(DEPTH, np.zeros(mesh.n_points)), dtype=np.float64)
    if depth.ndim != 1:
        raise ValueError(f"the field {DEPTH!r} must be one number per node, got {depth.shape}")
    numbered = [
        np.column_stack([np.arange(1, mesh.n_points + 1), mesh.points, depth]),
        np.column_stack([np.arange(1, mesh.n_cells + 1), mesh.cells + 1]),
    ]
    pieces: list[Any] = []
    boundaries = [] if mesh.tagged_facets is None else list(_boundaries(mesh))
    for kind in ("open", "land"):
        lists = [(n, t, own) for n, t, own in boundaries if (t is None) == (kind == "open")]
        total = sum(len(own) for *_, own in lists)
        pieces.append(f"{len(lists)} = number of {kind} boundaries\n")
        pieces.append(f"{total} = total number of {kind} boundary nodes\n")
        for number, (name, ibtype, own) in enumerate(lists, 1):
            count = len(own) if ibtype is None else f"{len(own)} {ibtype}"
            pieces.append(f"{count} = number of nodes for {kind} boundary {number}: {name}\n")
            pieces.append(("%d\n", own + 1))
    head = f"adaptsize\n{mesh.n_cells} {mesh.n_points}\n"
    lines = ("%d %.17g %.17g %.17g\n", "%d 3 %d %d %d\n")
    write_text(path, head, *zip(lines, numbered, strict=True), *pieces)


def _check_named(mesh: SimplexMesh) -> None:
    """Refuse barriers; warn of what models require and the mesh does not have."""
    used = set() if mesh.facet_tags is None else set(mesh.facet_tags.tolist())
    names = [mesh.tag_names.get((1, tag), "") for tag in sorted(used)]
    if barrier := next(filter(_BARRIERS.search, names), None):
        raise ValueError(
            f"the format of ADCIRC cannot hold {barrier!r}: barriers have heights and "
            "coefficients, which a mesh does not hold; rename the tag to write it as land"
        )
    lacking = ["depth (the nodal field 'depth'), 0 is written"] * (DEPTH not in mesh.point_data)
    lacking += ["tagged facets, so no boundaries"] * (not used)
    if lacking:
        warn_caller(f"the mesh has no {' and no '.join(lacking)}", InputWarning)


def _boundaries(mesh: SimplexMesh) -> Iterator[tuple[str, int | None, npt.NDArray[Any]]]:
    """Yield the name of each part of the boundary, its type or None if it is open, and its nodes.

    The domain is to the left.
    """
    found = mesh.boundary()
    edges, tags = found.nodes[found.mesh.cells], found.mesh.cell_tags
    tags = np.zeros(len(edges), np.int32) if tags is None else tags
    for ring in _rings(edges):
        start = edges[ring, 0]
        x, y = (mesh.points[start] - mesh.points[start[0]]).T
        is_island = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0.0
        breaks = np.flatnonzero(tags[ring] != np.roll(tags[ring], 1))
        turned = np.roll(ring, -breaks[0] if len(breaks) else 0)
        for part in np.split(turned, (breaks - breaks[0])[1:] if len(breaks) else []):
            name = mesh.tag_names.get((1, int(tags[part[0]])), "land")
            is_open = _OPEN.search(name) is not None
            nodes = np.append(edges[part, 0], edges[part[-1], 1])
            if is_island and not is_open and not len(breaks):
                nodes = nodes[:-1]
            closed = _RIVER if _RIVERS.search(name) else _ISLANDS[0] if is_island else _MAINLAND
            yield name, None if is_open else closed, nodes


def _rings(edges: npt.NDArray[Any]) -> Iterator[npt.NDArray[np.intp]]:
    """Yield the numbers of the edges of each ring in order."""
    leaving: dict[int, list[int]] = {}
    for number, node in enumerate(edges[:, 0].tolist()):
        leaving.setdefault(node, []).append(number)
    ends = edges[:, 1].tolist()
    while leaving:
        node, ring = next(iter(leaving)), []
        while node in leaving:
            ring.append(leaving[node].pop())
            if not leaving[node]:
                del leaving[node]
            node = ends[ring[-1]]
        yield np.array(ring)
