"""Connected components of a mesh in parts, and the points that lie in each."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adaptsize.background import CartesianGrid, SimplexMesh, topology
from adaptsize.background.partitioned import AnyMesh, PartitionedMesh, local_mesh
from adaptsize.limiting.problem import PointBounds, Problem
from adaptsize.ranks import Communicator, Ids
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Points this far outside, relative to the diagonal of the background, count as on the boundary:
# coordinates in files have seven to nine digits.
OUTSIDE = 1e-7

# Components this far from a point hold it.
_TOUCHING = 1e-9


class ComponentPiece(NamedTuple):
    """The part of one component on this rank, nodes in the order of the whole mesh.

    Methods then see nodes, edges and facets in the same order as in the whole mesh, and round
    alike.
    """

    ranks: Communicator
    mesh: SimplexMesh
    """On a rank without cells of the component, some simplex."""
    ids: Ids
    """int64[n]: global numbers, ascending; empty on a rank without cells of the component."""
    nodes: IntArray
    """int32[n]: the nodes in the part of the rank."""
    shared: list[IntArray]
    """For each rank, the nodes that it holds too, ascending."""

    @property
    def is_empty(self) -> bool:
        """Whether this rank has no cells of the component."""
        return len(self.ids) == 0

    @property
    def is_shared(self) -> BoolArray:
        """bool[n]: which nodes of ``mesh`` other ranks hold, too."""
        return topology.marked(np.concatenate(self.shared), self.mesh.n_points)

    def bounds(self, h0: FloatArray) -> FloatArray:
        """Return the bounds at the nodes of ``mesh``, given those in the part of the rank."""
        return np.full(self.mesh.n_points, np.inf) if self.is_empty else h0[self.nodes]


class Components(NamedTuple):
    """The components of the whole mesh."""

    number: IntArray
    """int32[n_local]: component of each local node, -1 for nodes in no cell."""
    total: int
    """Number of components."""

    def bounded(self, comm: Communicator, h0: FloatArray) -> list[int]:
        """Return the components in which a node has a bound; collective."""
        found = np.zeros(self.total + 1, np.int8)
        found[self.number[np.isfinite(h0)]] = 1
        found[-1] = 0
        everywhere = comm.allreduce(found, "max")
        return [int(k) for k in np.flatnonzero(everywhere)]


def is_connected(mesh: SimplexMesh) -> bool:
    """Return whether the mesh has one component, to which all nodes belong."""
    return not _roots_of(mesh).any()


def _roots_of(mesh: AnyMesh) -> IntArray:
    """Return for each node the smallest node of its component on this rank."""
    return topology.roots_of(mesh.cells, mesh.n_points)


def components_of(part: PartitionedMesh) -> Components:
    """Return the components; collective on first use."""
    return part.once("_components", lambda: _find_components(part))


def _find_components(part: PartitionedMesh) -> Components:
    roots, used = _roots_of(part), part.in_a_cell
    heads = np.flatnonzero(topology.marked(roots[used], part.n_points))
    label = np.where(used, part.global_ids[roots], -1)
    received = part.ranks.alltoallv([label[nodes] for nodes in part.shared.nodes])
    links = [np.column_stack([part.global_ids[heads]] * 2)]
    for nodes, theirs in zip(part.shared.nodes, received, strict=True):
        both = np.column_stack([label[nodes], theirs])
        both = both[(both >= 0).all(axis=1)]
        repeats = (both[1:] == both[:-1]).all(axis=1)  # nearly all
        links.append(np.unique(both[np.append(True, ~repeats)[: len(both)]], axis=0))
    every = np.concatenate(part.ranks.allgather(np.concatenate(links)))
    labels, ends = np.unique(every, return_inverse=True)
    of_label = topology.components_of(ends.reshape(-1, 2), len(labels))
    of_root = np.full(part.n_points, -1, np.int32)
    of_root[heads] = of_label[np.searchsorted(labels, part.global_ids[heads])]
    # A node without a cell here may have one on another rank.
    number = part.shared.merge(np.where(used, of_root[roots], np.int32(-1)), np.maximum)
    return Components(number, int(of_label.max(initial=-1)) + 1)


def piece_of(part: PartitionedMesh, component: int) -> ComponentPiece:
    """Return the part of a component on this rank."""
    return part.once(f"_piece_{component}", lambda: _find_piece(part, component))


def _find_piece(part: PartitionedMesh, component: int) -> ComponentPiece:
    number = components_of(part).number
    own = np.flatnonzero(number[part.cells[:, 0]] == component)
    if part.mesh is None or len(own) == 0:
        corners = np.vstack([np.zeros(part.dim), np.eye(part.dim)])
        simplex = SimplexMesh(corners, np.arange(part.dim + 1)[None])
        none = np.empty(0, np.int32)
        return ComponentPiece(
            part.ranks, simplex, part.global_ids[:0], none, [none] * part.ranks.size
        )
    nodes = np.flatnonzero(number == component)
    nodes = nodes[np.argsort(part.global_ids[nodes], kind="stable")]  # fast if sorted
    mesh, ids = part.mesh, part.global_ids[nodes]
    local = topology.places_among(nodes, part.n_points)
    if not np.array_equal(nodes, np.arange(part.n_points)):
        mesh = SimplexMesh(mesh.points[nodes], local[mesh.cells[own]])
    shared = [local[held][local[held] >= 0] for held in part.shared.nodes]
    return ComponentPiece(part.ranks, mesh, ids, nodes.astype(np.int32), shared)


def moved_inside(domain: AnyMesh, given: PointBounds) -> PointBounds:
    """Return the given points, those just outside moved to the boundary; collective.

    Walls would hide a point just behind them.
    """
    mesh, ranks = local_mesh(domain), domain.ranks
    away, feet = np.full(len(given.points), np.inf), given.points
    if mesh is not None:
        cells, weights, away = mesh.locator.nearest(given.points)
        feet = np.einsum("iv,ivd->id", weights, mesh.points[mesh.cells[cells]])
    least = ranks.allreduce(away, "min")
    first = ranks.allreduce(np.where(away == least, ranks.rank, ranks.size), "min")
    feet = np.where((first == ranks.rank)[:, None], feet, -np.inf)
    outside = (least > 0.0) & (least <= OUTSIDE * domain.diagonal)
    points = np.where(outside[:, None], ranks.allreduce(feet, "max"), given.points)
    return given._replace(points=points)


def points_in_components(part: PartitionedMesh, given: PointBounds | None) -> dict[int, IntArray]:
    """Return the bounded points that lie in each component; collective.

    Each rank sends pairs of numbers for the points in its part (one gather).
    """
    if given is None:
        return {}
    pairs = np.empty((0, 2), np.int32)
    number = components_of(part).number
    reach = _TOUCHING * part.diagonal
    if part.mesh is not None:
        which, cells = part.mesh.locator.within(given.points, reach)
        pairs = np.column_stack([number[part.cells[cells, 0]], which]).astype(np.int32)
        pairs = np.unique(pairs[np.isfinite(given.sizes)[which]], axis=0)
    every: IntArray = np.unique(np.concatenate(part.ranks.allgather(pairs)), axis=0)
    return {k: every[every[:, 0] == k, 1] for k in np.unique(every[:, 0]).tolist()}


def with_points_at_nodes(problem: Problem) -> Problem:
    """Return the problem with bounds at points as bounds at the nodes of their cells; collective.

    At a distance d from the point, a node gets its size plus g d.  No size is too small.
    """
    given, domain, g = problem.point_sources, problem.domain, float(problem.slope.values.max())
    if given is None:
        return problem
    h0 = problem.h0.copy()
    mesh = domain if isinstance(domain, CartesianGrid) else local_mesh(domain)
    if mesh is not None:
        around, _, away = mesh.locator.weights(given.points)
        inside = away <= OUTSIDE * domain.diagonal
        nodes, points = around[inside], given.points[inside]
        apart = np.linalg.norm(mesh.points[nodes] - points[:, None], axis=2)
        np.minimum.at(h0.reshape(-1), nodes, given.sizes[inside, None] + g * apart)
    if isinstance(domain, CartesianGrid):
        h0 = h0 if domain.active is None else np.where(domain.active, h0, np.inf)
    elif isinstance(domain, PartitionedMesh):
        h0 = domain.minimum(h0)
    return replace(problem, h0=h0, point_sources=None)
