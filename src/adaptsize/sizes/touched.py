"""Which nodes of a background a source or a boundary acts on, and the sizes that it requests there.

It acts on the nodes of the cells that it touches.  Those of a grid, the boxes, follow from the
indices of the nodes: no boxes and no coordinates are stored per node.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations, product
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_plain_array
from adaptsize._defaults import TOLERANCE
from adaptsize._messages import Message
from adaptsize.background import AnyBackground, AnyMesh, CartesianGrid, Octree, SimplexMesh
from adaptsize.background.interpolation import places_of
from adaptsize.background.migration import boundary_facets
from adaptsize.background.partitioned import local_mesh
from adaptsize.errors import OptionError
from adaptsize.sizes import tuning
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray, LongArray

# Points within this distance, in diagonals of the mesh, count as inside, and cells whose distances
# from a point differ by less are equally close.
_INSIDE = 1e-9

Nodes: TypeAlias = npt.NDArray[np.integer]
#: Tags by number or by name.
Tags: TypeAlias = int | str | Sequence[int | str]
_Domain: TypeAlias = AnyMesh | CartesianGrid
_Kind: TypeAlias = Literal["cell", "facet"]


class Touched(NamedTuple):
    """The nodes of the cells that contain points, or else of those that are closest to them."""

    which: LongArray
    """int64[k]: a point of each pair of a point and a node."""
    nodes: Nodes
    """int[k]"""
    distances: FloatArray
    """float64[n_points]: of each point, 0 inside."""
    spacing: FloatArray
    """float64[n_points]: of samples of a curve at each point."""

    @property
    def inside(self) -> BoolArray:
        """Which pairs are of points inside, bool[k]."""
        return np.asarray(self.distances[self.which] == 0.0)


def boundary_nodes(mesh: _Domain) -> Nodes:
    """Return the nodes on the boundary of the whole mesh or grid; collective.

    Those of a grid are the active nodes with inactive neighbours, including diagonal ones.  A
    closed surface or curve is the boundary of what it encloses.
    """
    if isinstance(mesh, CartesianGrid):
        from scipy import ndimage

        active = np.ones(mesh.shape, np.bool_) if mesh.active is None else mesh.active
        inner = ndimage.binary_erosion(active, np.ones((3,) * mesh.dim))
        return np.flatnonzero(active & ~inner)
    if isinstance(mesh, SimplexMesh):
        is_closed = mesh.cell_dim < mesh.dim and mesh.is_closed
        return np.unique(mesh.cells) if is_closed else mesh.boundary().nodes
    if mesh.cell_dim == 1:
        raise ValueError("the boundary of segments is not a mesh; cells must have 3 or 4 nodes")
    facets = boundary_facets(mesh)
    if mesh.cell_dim < mesh.dim and mesh.ranks.allreduce(len(facets), "sum") == 0:
        return np.unique(mesh.cells).astype(np.int32)
    return np.unique(facets).astype(np.int32)


def tagged_nodes(mesh: _Domain, kind: _Kind, tags: Tags) -> IntArray:
    """Return the nodes of cells or facets with some tags.  Refuse tags that do not occur."""
    if isinstance(mesh, CartesianGrid):
        text = f"tags need a SimplexMesh, a grid has none; got {mesh!r}"
        raise OptionError(Message("{sources}: {}", text))
    local = local_mesh(mesh)
    if local is not None:
        kind = _kind_of(local, kind, tags)
    rows, own = (None, None) if local is None else _tagged(local, kind)
    every = mesh.ranks.allgather(None if local is None or own is None else _names(local, kind))
    wanted = _occurring([found for found in every if found is not None], kind, tags)
    if rows is None or own is None:
        return np.empty(0, np.int32)
    nodes: IntArray = np.unique(rows[np.isin(own, wanted)])
    return nodes


def rows_with_tags(mesh: SimplexMesh, kind: _Kind, tags: Tags) -> tuple[IntArray, BoolArray]:
    """Return the cells or the tagged facets of a mesh, and which have some tags, as above."""
    kind = _kind_of(mesh, kind, tags)
    rows, own = _tagged(mesh, kind)
    if rows is None or own is None:
        own, rows = np.empty(0, np.int32), np.empty((0, mesh.cell_dim), np.int32)
    wanted = _occurring([_names(mesh, kind)] if len(own) else [], kind, tags)
    return rows, np.isin(own, wanted)


def _kind_of(mesh: SimplexMesh, kind: _Kind, tags: Tags) -> _Kind:
    """Return what tags are of: names of the boundary are those of faces, if the mesh is one."""
    by_name = any(isinstance(tag, str) for tag in _several(tags))
    return "cell" if by_name and mesh.cell_dim < mesh.dim and mesh.facet_tags is None else kind


def _several(tags: Tags) -> list[Any]:
    """Return numbers and names of tags as a list."""
    if isinstance(tags, str):
        return [tags]
    if isinstance(tags, Sequence) and any(isinstance(tag, str) for tag in tags):
        return list(tags)
    return [*np.atleast_1d(as_plain_array("tags", tags)).tolist()]


def _names(mesh: SimplexMesh, kind: _Kind) -> dict[int, str]:
    """Return the names of the tags that occur, by default what they are and the number."""
    dim = mesh.cell_dim - (kind == "facet")
    what = "region" if dim == mesh.dim else "face"
    own = _tagged(mesh, kind)[1]
    tags = [] if own is None else np.unique(own).tolist()
    return {tag: mesh.tag_names.get((dim, tag), f"{what} {tag}") for tag in tags}


def _tagged(mesh: SimplexMesh, kind: _Kind) -> tuple[IntArray | None, IntArray | None]:
    if kind == "cell":
        return mesh.cells, mesh.cell_tags
    return mesh.tagged_facets, mesh.facet_tags


def _occurring(present: Sequence[dict[int, str]], kind: _Kind, tags: Tags) -> npt.NDArray[Any]:
    """Return the numbers of tags, if all are among those that are present, with their names."""
    name = f"{kind}_tags"
    if not present:
        what = "region" if kind == "cell" else "facet"
        text = f"tags must be {what} tags of the mesh, which has none ({name} is None)"
        raise OptionError(Message("{sources}: {}", text))
    names = {tag: title for part in present for tag, title in part.items()}
    wanted = []
    for given in _several(tags):
        own = [tag for tag, title in names.items() if given in (tag, title)]
        if not own:
            listed = ", ".join(
                str(names[t] if isinstance(given, str) else t) for t in sorted(names)
            )
            text = f"tags must be among the {name} {listed}, got {given}"
            raise OptionError(Message("{sources}: {}", text))
        wanted += own
    return np.array(wanted, np.int64)


def cells_around(domain: _Domain, points: FloatArray) -> Touched:
    """Return the nodes of all cells that contain points, or else are closest; collective."""
    if isinstance(domain, CartesianGrid):
        away = np.linalg.norm(points - np.clip(points, domain.lower, domain.upper), axis=1)
        spacing = np.full(len(points), float(domain.spacing.min()) / tuning.SAMPLES_PER_LENGTH)
        return Touched(*_corners_around(domain, points), away, spacing)
    inside, local = _INSIDE * domain.diagonal, local_mesh(domain)
    away = np.full(len(points), np.inf)
    if local is not None:
        away = local.locator.nearest(points)[2]
    away = domain.ranks.allreduce(away, "min")
    which, cells = np.empty(0, np.int64), np.empty(0, np.int32)
    if local is not None:
        which, cells = local.locator.within(points, away + inside)
    corners = domain.points[domain.cells[cells]]
    lengths = [np.linalg.norm(step, axis=1) for _, step in _edges(corners)]
    widths = np.full(len(points), np.inf)
    np.minimum.at(widths, which, np.mean(lengths, axis=0))
    spacing = domain.ranks.allreduce(widths, "min") / tuning.SAMPLES_PER_LENGTH
    return Touched(
        np.repeat(which, domain.cell_dim + 1),
        domain.cells[cells].ravel(),
        np.where(away <= inside, 0.0, away),
        # Smaller cells are degenerate and need no denser samples.
        np.maximum(spacing, 1e-6 * domain.diagonal),
    )


def samples_along(
    domain: _Domain, curve: SimplexMesh
) -> tuple[Nodes, LongArray, FloatArray, BoolArray]:
    """Return the nodes that samples along segments touch, with a density adapted to the cells.

    Returns
    -------
    nodes : int[k]
    segments : int64[k]
    along : float64[k]
        The position of the sample on its segment, from 0 to 1.
    inside : bool[k]
        False if the sample lies outside the domain and the cell is only the closest one.
    """
    a, b = curve.points[curve.cells[:, 0]], curve.points[curve.cells[:, 1]]
    lengths = np.linalg.norm(b - a, axis=1)
    segment = np.arange(curve.n_cells)
    lower, upper = np.zeros(curve.n_cells), np.ones(curve.n_cells)
    found = []

    def visit(points: FloatArray, along: FloatArray) -> Touched:
        at = cells_around(domain, points)
        found.append((at.nodes, segment[at.which], along[at.which], at.inside))
        return at

    visit(a, lower)
    visit(b, upper)
    while len(segment) > 0:  # halve the pieces until they are short enough
        middle = 0.5 * (lower + upper)
        at = visit(a[segment] + middle[:, None] * (b - a)[segment], middle)
        # A piece far from the domain cannot touch it, however small the cells are.
        long = (upper - lower) * lengths[segment] > at.spacing + at.distances
        segment = np.repeat(segment[long], 2)
        lower, upper = (
            np.column_stack([lower[long], middle[long]]).ravel(),
            np.column_stack([middle[long], upper[long]]).ravel(),
        )
    nodes, segment, along, inside = (np.concatenate(part) for part in zip(*found, strict=True))
    return nodes, segment, along, inside


def nodes_beside_box(domain: _Domain, lower: FloatArray, upper: FloatArray) -> Nodes:
    """Return the nodes of the cells that meet a box; collective."""
    if isinstance(domain, CartesianGrid):
        return _corners_beside(domain, lower, upper, 0.0)
    at = cells_around(domain, 0.5 * (lower + upper)[None])
    nodes, _, _, inside = samples_along(domain, _box_edges(lower, upper))
    meeting = domain.cells[_have_edge_in_box(domain, lower, upper)]
    return np.concatenate([meeting.ravel(), at.nodes[at.inside], nodes[inside]])


def nodes_beside_ball(domain: _Domain, centre: FloatArray, radius: float) -> Nodes:
    """Return the nodes of the cells that meet a ball; collective."""
    if isinstance(domain, CartesianGrid):
        return _corners_beside(domain, centre, centre, radius)
    reach, local = radius + _INSIDE * domain.diagonal, local_mesh(domain)
    if local is None:
        return np.empty(0, np.int32)
    return local.cells[local.locator.within(centre[None], reach)[1]].ravel()


def _have_edge_in_box(mesh: AnyMesh, lower: FloatArray, upper: FloatArray) -> BoolArray:
    """Return which cells have an edge that intersects a box."""
    meets = np.zeros(len(mesh.cells), np.bool_)
    for start, step in _edges(mesh.points[mesh.cells]):
        first, last = np.zeros(len(start)), np.ones(len(start))
        hit = np.ones(len(start), np.bool_)
        for d in range(mesh.dim):
            moving = step[:, d] != 0.0
            rate = np.where(moving, step[:, d], 1.0)
            one, two = (lower[d] - start[:, d]) / rate, (upper[d] - start[:, d]) / rate
            first = np.where(moving, np.maximum(first, np.minimum(one, two)), first)
            last = np.where(moving, np.minimum(last, np.maximum(one, two)), last)
            hit &= moving | ((start[:, d] >= lower[d]) & (start[:, d] <= upper[d]))
        meets |= hit & (first <= last)
    return meets


def _box_edges(lower: FloatArray, upper: FloatArray) -> SimplexMesh:
    """Return the 2, 4 or 12 edges of a box as segments."""
    dim = len(lower)
    corner = np.arange(2**dim)
    points = np.where((corner[:, None] >> np.arange(dim)) & 1, upper, lower)
    edges = [(i, i | 1 << d) for i in corner for d in range(dim) if not i >> d & 1]
    return SimplexMesh(points, edges)


def _edges(corners: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    for i, j in combinations(range(corners.shape[1]), 2):
        yield corners[:, i], corners[:, j] - corners[:, i]


def lower(h0: FloatArray, nodes: Nodes, requested: npt.ArrayLike) -> None:
    """Lower ``h0`` (In/Out) at nodes, which may be repeated, to the requested sizes there."""
    np.minimum.at(h0, np.unravel_index(nodes, h0.shape), requested)


def lower_along(
    domain: _Domain, curve: SimplexMesh, size: FloatArray, g: float, h0: FloatArray
) -> None:
    """Lower ``h0`` (In/Out) to ``size + g |x - y|`` from points y of a curve."""
    nodes, segment, along, _ = samples_along(domain, curve)
    (a, b), place = curve.cells[segment].T, places_of(domain)
    samples = (1.0 - along)[:, None] * curve.points[a] + along[:, None] * curve.points[b]
    # An end of share 0 is ignored, because inf would give nan.
    at_samples = np.where(along < 1.0, size[a], 0.0) * (1.0 - along)
    at_samples += np.where(along > 0.0, size[b], 0.0) * along
    away = np.linalg.norm(place(nodes) - samples, axis=1)
    lower(h0, nodes, at_samples + g * away)
    # The closest point of the curve may be in another cell, or between two samples.
    unique = np.unique(nodes)
    at_nearest, distances = curve.locator.interpolate(size, place(unique))
    lower(h0, unique, at_nearest + g * distances)


def nodes_beside(
    background: AnyBackground, boundary: SimplexMesh, tolerance: float | None
) -> tuple[IndexArray, float | FloatArray]:
    """Return the nodes up to a tolerance from a boundary, and the tolerance at each or at all.

    By default, the nodes of a mesh must be on the boundary.  Those of a grid may be a diagonal of a
    box away from it, and those of an octree must be in leaves that it passes.
    """
    if tolerance is None and isinstance(background, Octree):
        diagonals = np.linalg.norm(background.leaf_sizes, axis=1)
        passed = boundary.locator.nearest(background.leaf_centres)[2] <= 0.5 * diagonals
        reach = np.zeros(background.n_points)
        of_cells = np.repeat(np.where(passed, diagonals, 0.0), np.diff(background.first_cells))
        np.maximum.at(reach, background.mesh.cells, of_cells[:, None])
        nodes = np.flatnonzero(reach)
        return nodes, reach[nodes]
    if isinstance(background, CartesianGrid):
        within = float(np.linalg.norm(background.spacing)) if tolerance is None else tolerance
        return _grid_nodes_near(background, boundary, within), within
    within = TOLERANCE * boundary.diagonal if tolerance is None else tolerance
    return np.flatnonzero(boundary.locator.nearest(background.points)[2] <= within), within


def _grid_nodes_near(grid: CartesianGrid, mesh: SimplexMesh, within: float) -> IndexArray:
    """Return the active nodes up to a distance from a mesh.

    Blocks of nodes are halved along each axis while they may contain such nodes.
    """
    shape = np.array(grid.shape)
    edge = 1
    while (shape > 8 * edge).any():
        edge *= 2
    corners = np.array(list(product((0, 1), repeat=grid.dim)))
    blocks = np.argwhere(np.ones(-(-shape // edge), np.bool_))
    while True:
        first, last = edge * blocks, np.minimum(edge * (blocks + 1), shape) - 1
        distance = mesh.locator.nearest(grid.origin + grid.spacing * 0.5 * (first + last))[2]
        reach = 0.5 * np.linalg.norm(grid.spacing * (last - first), axis=1)
        blocks = blocks[distance <= within + reach * (1.0 + 1e-9)]
        if edge == 1:
            break
        edge //= 2
        blocks = (2 * blocks[:, None] + corners).reshape(-1, grid.dim)
        blocks = blocks[(edge * blocks < shape).all(axis=1)]
    return _active(grid, _numbers(grid, blocks))


def _corners_around(grid: CartesianGrid, points: FloatArray) -> tuple[LongArray, IndexArray]:
    """Return the corners of the boxes around points: the number of the point, and the node.

    A point outside belongs to the closest box.  If no corner of it is active, it belongs to
    the nearest active node.
    """
    last = np.array(grid.shape) - 2
    # Clipped before they become integers: points may be far away.
    boxes = np.clip(np.floor((points - grid.lower) / grid.spacing), 0.0, last).astype(np.int64)
    corners = np.array(list(product((0, 1), repeat=grid.dim)))
    nodes = _numbers(grid, (boxes[:, None, :] + corners).reshape(-1, grid.dim))
    which = np.repeat(np.arange(len(points)), len(corners))
    if grid.active is not None:
        good = grid.active.ravel()[nodes]
        lost = np.flatnonzero(~good.reshape(len(points), -1).any(axis=1))
        nodes, which = nodes[good], which[good]
        if len(lost):
            nodes = np.concatenate([nodes, _nearest_active(grid, points[lost])])
            which = np.concatenate([which, lost])
    return which, nodes


def _corners_beside(
    grid: CartesianGrid, lower: FloatArray, upper: FloatArray, radius: float
) -> IndexArray:
    """Return the corners of the boxes that are within a radius of a box, or of a point."""
    ends = np.clip([lower, upper], grid.lower, grid.upper)
    beyond = np.maximum(np.maximum(lower - grid.upper, grid.lower - upper), 0.0)
    gaps, index = [], []
    for d, x in enumerate(grid.axes):
        # The boxes around a node extend one spacing from it.  Those that extend beyond the grid
        # intersect the ball only where the ball is outside as well.
        to_node = np.abs(x - np.clip(x, *ends[:, d]))
        gap = np.maximum(to_node - grid.spacing[d], 0.0) + beyond[d]
        index.append(np.flatnonzero(gap <= radius))
        gaps.append(gap[index[-1]] ** 2)
    meets = np.array(sum(np.meshgrid(*gaps, indexing="ij", sparse=True))) <= radius**2
    nodes = np.stack(np.meshgrid(*index, indexing="ij"), axis=-1)[meets]
    return _active(grid, _numbers(grid, nodes))


def _nearest_active(grid: CartesianGrid, points: FloatArray) -> IndexArray:
    """Return the nearest active node of each point in or outside boxes without any."""
    from scipy.spatial import cKDTree

    # It has a neighbour that is not active, or it would not be the nearest.
    nodes = boundary_nodes(grid)
    return np.asarray(nodes[cKDTree(places_of(grid)(nodes)).query(points)[1]])


def _numbers(grid: CartesianGrid, index: LongArray) -> IndexArray:
    """Return the numbers of nodes with given indices along the axes, int64[n, dim]."""
    return np.asarray(np.ravel_multi_index(tuple(index.T), grid.shape))


def _active(grid: CartesianGrid, nodes: IndexArray) -> IndexArray:
    return nodes if grid.active is None else nodes[grid.active.ravel()[nodes]]
