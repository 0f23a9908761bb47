"""Whether a mesh needs to be remeshed for given sizes: whether, where and why."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_sizes_at, refuse_where
from adaptsize.adaptation import tuning
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.background._mesh_arrays import lengths
from adaptsize.background.migration import is_counted_here
from adaptsize.background.partitioned import local_mesh
from adaptsize.background.simplex import as_mesh
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import NeedOptions, checked, with_options
from adaptsize.quality.by_place import BAND
from adaptsize.quality.conformity import SizeLike, nodal_metric
from adaptsize.quality.elements import folded_cells, minimum_angles
from adaptsize.sizes.budget import calibration, count_elements
from adaptsize.typing import BoolArray, FloatArray, IntArray, Unpack

#: Sizes at the nodes of a mesh, or the metric there.
Requested: TypeAlias = FloatArray | Metric


class MissedPlace(NamedTuple):
    """A place where a mesh differs from the requested sizes."""

    severity: float
    """Factor by which an edge or an angle there misses what it should be; inf if cells overlap."""
    point: tuple[float, ...]
    """Centroid of the worst cell."""
    reason: str

    def __str__(self) -> str:
        """Return the point and the reason."""
        return f"({', '.join(f'{x:.4g}' for x in self.point)}): {self.reason}"


@dataclass(frozen=True)
class RemeshingNeed:
    """What `needs_remeshing` returns.  It is true if a new mesh is needed.

    Attributes
    ----------
    needed : bool
    reason : str
        Why, or why not.
    share_in_band : float
        Share of the cells of the next mesh that the mesh already has, see `AdaptReport`.
    share_too_long, share_too_short : float
        Shares of the next mesh where the edges are too long and too short.
    n_cells, predicted_cells : float
        Number of cells now, and predicted for the sizes.
    cells : int32[n]
        Cells, of this rank, with an edge out of the band, an angle that is too small, or that
        overlap a neighbour; the worst first.
    places : tuple of MissedPlace
        At most five places of the worst cells, a tenth of the diagonal apart.
    """

    needed: bool
    reason: str
    share_in_band: float
    share_too_long: float
    share_too_short: float
    n_cells: int
    predicted_cells: float
    cells: IntArray
    places: tuple[MissedPlace, ...]

    def __bool__(self) -> bool:
        """Return whether a new mesh is needed."""
        return self.needed

    def __str__(self) -> str:
        """Return the reason and the places."""
        lines = [
            self.reason,
            f"{self.n_cells} cells, predicted {self.predicted_cells:.0f}; "
            f"{self.share_in_band:.0%} of the next mesh present already, "
            f"{self.share_too_long:.0%} too long, {self.share_too_short:.0%} too short",
        ]
        return "\n".join([*lines, *(f"  at {place}" for place in self.places)])


@with_options(NeedOptions)
def needs_remeshing(
    mesh: AnyMesh, size: SizeLike | Metric | MetricFunction, **options: Unpack[NeedOptions]
) -> RemeshingNeed:
    """Return whether a mesh needs to be remeshed for given sizes, where, and why.

    A new mesh is needed if less than ``enough`` of the next mesh is there, as in `adapt`, if the
    number of cells would change by more than 15 %, if an edge is to be divided into more than
    three, or if a cell has a small angle or overlaps a neighbour.  No mesh is made.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
        Triangles or tetrahedra, for instance one whose nodes have moved.
    size : SizeFunction, callable, array_like of float, shape (n_points,), or float
        Requested edge length, finite, evaluated at the nodes; its gradient is not limited here.
        Or a `Metric` at the nodes, a `MetricFunction` or a callable that returns a Metric, for
        whole meshes.  Angles do not count then, since cells in a metric are thin.
    **options

    Returns
    -------
    RemeshingNeed
        ``needed``, ``reason``, shares of the next mesh, ``cells`` and ``places``.  It can be used
        as a condition.  On several ranks all but ``cells`` is the same everywhere.

    Raises
    ------
    ValueError
        If the mesh consists of segments, or a size is not finite and positive.

    Notes
    -----
    The cost is that of some passes over edges and cells: 2 microseconds per triangle and 4 per
    tetrahedron.  Collective for a mesh in parts.

    The orientation of cells does not matter: two cells overlap if they are on one side of their
    common facet.  Cells on different ranks are not compared.  Corners of the domain sharper than
    ``least_angle`` count, too, though no mesh can avoid them.

    Examples
    --------
    Two triangles need a new mesh where the sizes are small:

    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> need = needs_remeshing(mesh, [0.1, 1.0, 1.0, 1.0])
    >>> need.needed, need.cells
    (True, array([0, 1], dtype=int32))
    >>> bool(needs_remeshing(mesh, 1.1))
    False
    """
    mesh = as_mesh("mesh", mesh, PartitionedMesh)
    if mesh.cell_dim == 1:
        raise ValueError(f"mesh must consist of triangles or tetrahedra, got {mesh!r}")

    def check() -> tuple[NeedOptions, Requested]:
        return checked(NeedOptions, options), _as_requested(mesh, size)

    given, requested = mesh.ranks.agree(check)
    mesh.ranks.require_equal(**given)
    if isinstance(mesh, PartitionedMesh):
        mesh.require_equal_values("size", smallest(requested))
    predicted = calibration("mmg", mesh.cell_dim) * count_simplices(mesh, requested)
    present = present_of(mesh, requested)
    allowed = 0.0 if isinstance(requested, Metric) else given["least_angle"]
    misses = _misses_of(mesh, requested, allowed)
    reasons = []
    if not present.has_sizes(predicted, given["enough"]):
        reasons.append(present.reason)
    counts = np.array([np.isfinite(misses.angles).sum(), misses.folded.sum()])
    n_flat, n_folded = mesh.ranks.allreduce(counts, "sum").tolist()
    if n_folded:
        reasons.append(f"cells that overlap a neighbour: {n_folded}")
    if n_flat:
        least = -mesh.ranks.allreduce(-float(misses.angles.min(initial=np.inf)), "max")
        reasons.append(
            f"cells with angles below {allowed:g} degrees: {n_flat}, the smallest {least:.2g}"
        )
    share = present.shares[0]
    text = f"needed: {'; '.join(reasons)}" if reasons else f"not needed: {share:.0%} is there"
    severity = misses.severity
    worst = np.argsort(-severity, kind="stable")[: np.count_nonzero(severity > BAND[1])]
    return RemeshingNeed(
        bool(reasons), text, *present.shares, present.n_cells, predicted,
        worst.astype(np.int32), _places(mesh, misses, worst),
    )  # fmt: skip


def _as_requested(mesh: AnyMesh, size: SizeLike | Metric | MetricFunction) -> Requested:
    """Return the checked sizes or the metric at the nodes."""
    if isinstance(mesh, SimplexMesh):
        metric = nodal_metric(mesh, size)
        if metric is not None:
            return metric
    elif isinstance(size, Metric | MetricFunction):
        raise ValueError("size must be sizes on several ranks, got a metric")
    h = as_sizes_at("size", size, mesh.points)
    refuse_where("size", np.isinf(h), h, "must be finite")
    return h


def smallest(requested: Requested) -> FloatArray:
    """Return the sizes at the nodes, the smallest ones if they depend on the direction."""
    return requested.sizes[:, 0] if isinstance(requested, Metric) else requested


def count_simplices(mesh: AnyMesh, requested: Requested) -> float:
    """Return the number of regular simplices of the requested sizes; collective."""
    if isinstance(requested, Metric):
        assert isinstance(mesh, SimplexMesh), "metrics are refused for meshes in parts"
        return requested.predicted_elements(mesh)
    return count_elements(mesh, requested)


def pieces_of(points: FloatArray, edges: IntArray, requested: Requested) -> FloatArray:
    """Return the number of pieces of the requested size for each edge, with h linear along it."""
    if isinstance(requested, Metric):
        return requested.edge_lengths(points, edges)
    i, j = edges.T
    h = requested
    mean = 0.5 * (h[i] + h[j])
    half = np.abs(h[i] - h[j]) / (2.0 * mean)  # below 1
    # The mean of 1/h over the mean's inverse is artanh(x) / x.
    near = half < 1e-4
    growth = np.where(near, 1.0, np.arctanh(half) / np.where(near, 1.0, half))
    return np.asarray(lengths(points, edges) / mean * growth)


class Present(NamedTuple):
    """How the present mesh compares with the next sizes."""

    n_cells: int
    weights: FloatArray
    """Total weight of the edges, and the weights of those too long and too short, float64[3].

    An edge to be divided into r pieces is weighted by the r^d cells that replace it, or r in a
    metric, where cells are divided along one direction.  A few cells that are much too long at a
    singular point can become most of the next mesh.
    """
    longest: float
    """Largest number of pieces into which an edge is to be divided."""

    @property
    def shares(self) -> tuple[float, float, float]:
        """Return the shares of the next mesh that are in band, too long and too short."""
        too_long, too_short = (self.weights[1:] / self.weights[0]).tolist()
        return 1.0 - too_long - too_short, too_long, too_short

    def has_sizes(self, predicted: float, enough: float) -> bool:
        """Return whether the mesh has the sizes, for which a number of cells is predicted."""
        same = abs(predicted / self.n_cells - 1.0) <= tuning.BUDGET
        # A region that is much too coarse counts, however few cells it has.
        return same and self.shares[0] >= enough and self.longest <= tuning.MOST_PIECES

    @property
    def reason(self) -> str:
        """Return how the mesh differs from the sizes."""
        _, too_long, too_short = self.shares
        text = f"{too_long:.0%} of the next mesh is too coarse in the old one, "
        text += f"{too_short:.0%} too fine"
        if self.longest > tuning.MOST_PIECES:
            text += f", an edge is {self.longest:.2g} times too long"
        return text


def present_of(mesh: AnyMesh, requested: Requested) -> Present:
    """Return how a mesh compares with the next sizes; collective."""
    weights, longest = np.zeros(3), 0.0
    whole = local_mesh(mesh)
    counted = is_counted_here(mesh, np.empty((0, 2), np.int32) if whole is None else whole.edges)
    if whole is not None:
        pieces = pieces_of(whole.points, whole.edges, requested)
        longest, pieces = float(pieces.max()), pieces[counted]
        weight = np.maximum(pieces, 1.0) ** (1 if isinstance(requested, Metric) else mesh.cell_dim)
        off = [np.ones_like(pieces, bool), pieces > BAND[1], pieces < 1.0 / BAND[1]]
        weights = np.array([weight[which].sum() for which in off])
    ranks, n_cells = mesh.ranks, len(mesh.cells)
    total = ranks.allreduce(weights, "sum")
    return Present(
        int(ranks.allreduce(n_cells, "sum")), total, float(ranks.allreduce(longest, "max"))
    )


class _Misses(NamedTuple):
    """By how much the cells of this rank miss the sizes and the least angle."""

    longest: FloatArray
    """Largest number of pieces of an edge, float64[n_cells]."""
    shortest: FloatArray
    angles: FloatArray
    """Degrees, inf where they are large enough."""
    folded: BoolArray
    severity: FloatArray
    """The factor by which each cell misses the request."""

    def reason(self, cell: int) -> str:
        """Return what is wrong with a cell."""
        if self.folded[cell]:
            return "a cell that overlaps a neighbour"
        if np.isfinite(self.angles[cell]):
            return f"an angle of {self.angles[cell]:.2g} degrees"
        long, short = float(self.longest[cell]), float(self.shortest[cell])
        if long * short >= 1.0:
            return f"an edge {long:.2g} times too long"
        return f"an edge {1.0 / max(short, 1e-300):.2g} times too short"


def _misses_of(mesh: AnyMesh, requested: Requested, least_angle: float) -> _Misses:
    """Measure the cells of this rank."""
    whole = local_mesh(mesh)
    n = len(mesh.cells)
    folded = np.zeros(n, np.bool_)
    longest, shortest, angles = np.zeros(n), np.full(n, np.inf), np.full(n, np.inf)
    if whole is not None:
        for pair in combinations(range(mesh.cell_dim + 1), 2):
            ratio = pieces_of(whole.points, whole.cells[:, pair], requested)
            longest, shortest = np.maximum(longest, ratio), np.minimum(shortest, ratio)
        if least_angle > 0.0:
            found = minimum_angles(whole)
            angles = np.where(found < least_angle, found, np.inf)
        if whole.cell_dim == whole.dim:
            folded = folded_cells(whole)
    with np.errstate(divide="ignore"):
        severity = np.maximum.reduce([longest, 1.0 / shortest, 2.0 * least_angle / angles])
    severity[folded] = np.inf
    return _Misses(longest, shortest, angles, folded, severity)


def _places(mesh: AnyMesh, misses: _Misses, worst: npt.NDArray[np.intp]) -> tuple[MissedPlace, ...]:
    """Return places of the worst cells that are apart from each other; collective."""
    severity, free = misses.severity[worst], np.ones(len(worst), np.bool_)
    centroids = mesh.points[mesh.cells[worst]].mean(axis=1)
    distance = tuning.APART * mesh.diagonal
    places: list[MissedPlace] = []
    while len(places) < tuning.N_PLACES:
        own = None
        if free.any():
            row = int(free.argmax())
            point = tuple(centroids[row].tolist())
            own = MissedPlace(float(severity[row]), point, misses.reason(worst[row]))
        every = [place for place in mesh.ranks.allgather(own) if place is not None]
        if not every:
            break
        places.append(min(every, key=lambda place: (-place.severity, place.point)))
        free &= np.linalg.norm(centroids - np.array(places[-1].point), axis=1) > distance
    return tuple(places)
