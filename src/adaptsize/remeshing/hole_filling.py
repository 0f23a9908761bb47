"""Triangles that close the holes of a surface."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from adaptsize._checks import check_type
from adaptsize._messages import Message
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import components_of
from adaptsize.geometry.enclosed import cone_measures
from adaptsize.remeshing import tuning
from adaptsize.remeshing.preparation import RepairedMesh, repair_mesh
from adaptsize.typing import FloatArray, IntArray


def close_holes(surface: SimplexMesh) -> SimplexMesh:
    """Return a surface whose holes are closed by triangles between the nodes of their edges.

    See `SimplexMesh.close_holes`.
    """
    repaired = _repaired(surface)
    mesh = repaired.mesh
    new = [fill_loop(mesh.points, loop) for loop in boundary_loops(mesh)]
    cells = np.concatenate([mesh.cells, *new]).astype(np.int32)
    tags = mesh.cell_tags
    if tags is not None:
        tags = np.concatenate([tags, np.zeros(len(cells) - mesh.n_cells, tags.dtype)])
    closed = SimplexMesh(
        mesh.points,
        cells,
        cell_tags=tags,
        tag_names=mesh.tag_names,
        point_data={name: values[repaired.nodes] for name, values in surface.point_data.items()},
    )
    if not closed.is_closed:
        count = int((closed.facet_cell_counts == 1).sum())
        raise ValueError(
            f"surface has {count} open edges that form no loop, so its holes cannot be closed"
        )
    if not _encloses_volume(closed):
        text = (
            "surface encloses no volume when its holes are closed: it is a sheet; remesh it with "
        )
        raise ValueError(Message("{}{target:'triangles'}", text))
    return closed


def merged_surface(surface: SimplexMesh) -> SimplexMesh:
    """Return a surface without coincident points and useless triangles."""
    return _repaired(surface).mesh


def _repaired(surface: SimplexMesh) -> RepairedMesh:
    check_type("surface", surface, SimplexMesh)
    if surface.cell_dim != 2 or surface.dim != 3:
        raise ValueError(f"surface must consist of triangles in space, got {surface!r}")
    return repair_mesh(surface)


def bodies_of(surface: SimplexMesh) -> npt.NDArray[np.intp]:
    """Return the number 0, 1, ... of the connected component of each triangle."""
    label = components_of(surface.facets, surface.n_points)[surface.cells[:, 0]]
    return np.asarray(np.unique(label, return_inverse=True)[1], np.intp)


def boundary_loops(surface: SimplexMesh) -> Iterator[list[int]]:
    """Yield the simple loops of open edges, as nodes.

    Triangles of nodes in this order are oriented like those on the other side of the edges, if
    these agree with each other.  Edges of a path that ends are not yielded.
    """
    if surface.is_closed:
        return
    boundary = surface.boundary()
    ends = boundary.nodes[boundary.mesh.cells]
    beside: dict[int, dict[int, int]] = defaultdict(dict)  # neighbour: 1 if the edge leads there
    for a, b in ends.tolist():
        beside[a][b], beside[b][a] = 1, 0
    for start in list(beside):
        while beside[start]:
            path, forward = [start], [0]
            at = {start: 0}
            while beside[path[-1]]:
                here = path[-1]
                step = max(beside[here], key=lambda node: beside[here][node])
                way = beside[here].pop(step)
                del beside[step][here]
                if step not in at:
                    at[step] = len(path)
                    path.append(step)
                    forward.append(way)
                    continue
                first = at[step]
                loop = path[first:]
                along = sum(forward[first + 1 :]) + way
                for node in loop[1:]:
                    del at[node]
                del path[first + 1 :], forward[first + 1 :]
                yield loop[::-1] if 2 * along >= len(loop) else loop


def fill_loop(points: FloatArray, loop: Sequence[int]) -> IntArray:
    """Return triangles of small total area inside a loop of nodes, int32[n, 3]."""
    if len(loop) == 3:
        return np.asarray([loop], np.int32)
    if len(loop) <= tuning.MOST_EDGES_AT_ONCE:
        nodes = np.asarray(loop, np.int32)
        return nodes[_least_area(points[nodes])]
    stride = -(-len(loop) // tuning.MOST_EDGES_AT_ONCE)
    corners = [*range(0, len(loop), stride), len(loop)]
    closed = [*loop, loop[0]]
    parts = [fill_loop(points, [loop[k] for k in corners[:-1]])]
    for first, last in pairwise(corners):
        if last - first > 1:
            parts.append(fill_loop(points, closed[first : last + 1]))
    return np.concatenate(parts)


def _least_area(points: FloatArray) -> IntArray:
    """Return the triangulation of least area of a closed polygon in space.

    ``cost[i, j]`` is that of the part of the polygon from i to j, closed by a chord.
    """
    n = len(points)
    cost = np.zeros((n, n))
    middle = np.zeros((n, n), np.intp)
    for gap in range(2, n):
        first = np.arange(n - gap)
        i, j = first[:, None], first[:, None] + gap
        k = i + np.arange(1, gap)
        total = cost[i, k] + cost[k, j] + _triangle_cost(points[i], points[k], points[j])
        best = np.argmin(total, axis=1)
        cost[first, first + gap] = total[first, best]
        middle[first, first + gap] = first + 1 + best
    triangles, waiting = [], [(0, n - 1)]
    while waiting:
        a, c = waiting.pop()
        if c - a > 1:
            b = int(middle[a, c])
            triangles.append((a, b, c))
            waiting += [(a, b), (b, c)]
    return np.array(triangles, np.int32).reshape(-1, 3)


def _triangle_cost(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1)
    perimeter = sum(np.linalg.norm(p - q, axis=-1) for p, q in ((a, b), (b, c), (c, a)))
    return np.asarray(area + tuning.WEIGHT_OF_PERIMETER * perimeter**2)


def _encloses_volume(closed: SimplexMesh) -> bool:
    """Return whether some component of a closed surface encloses a volume."""
    body = bodies_of(closed)
    volume = np.abs(np.bincount(body, cone_measures(closed, closed.points.mean(axis=0))))
    area = np.bincount(body, closed.measures)
    return bool((volume > tuning.NO_VOLUME * closed.diagonal * area).any())
