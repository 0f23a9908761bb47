"""Conformity of a mesh with a size function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from adaptsize._checks import FARTHEST, as_sizes, as_sizes_at, refuse_where
from adaptsize._size_function import SizeFunction
from adaptsize._workers import in_all_threads
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh, topology
from adaptsize.background.migration import boundary_facets, is_counted_here
from adaptsize.background.requests import boxes_of, ranks_within
from adaptsize.background.simplex import as_mesh
from adaptsize.geometry.solid import Solid
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.quality.boundary import distances_from, distances_from_solid
from adaptsize.quality.by_place import RequestedElements, Served, WorstPlace, is_in_band
from adaptsize.quality.elements import (
    MetricQuality,
    check_cells,
    flat_cells,
    metric_quality,
    minimum_angles,
    radius_ratios,
)
from adaptsize.ranks import Communicator, split_rows, values_in_order
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Requested edge lengths: a SizeFunction or another callable, one per node, or a number.
SizeLike: TypeAlias = SizeFunction | Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike

_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
#: Some milliseconds.
_EDGES_AT_ONCE = 1 << 17
_NO_SIZE = "size must be finite on one edge at least, got inf everywhere"


@dataclass(frozen=True)
class RatioStatistics:
    """Statistics of edge length over requested size for a set of edges."""

    n_edges: int
    """Number of edges with a finite requested size.  Other edges are ignored."""
    q05: float
    q25: float
    q50: float
    q75: float
    q95: float
    mean: float
    share_in_band: float
    """Share of the edges with a ratio in [1/sqrt 2, sqrt 2]."""


@dataclass(frozen=True)
class Conformity:
    """How closely a mesh follows a size function, and the quality of its cells.

    Attributes
    ----------
    n_points, n_cells : int
    cell_dim : int
        2 triangles, 3 tetrahedra.
    edges : RatioStatistics
        Over all edges.
    boundary_edges : RatioStatistics or None
        Over the edges on the boundary; None if none of them has a finite requested size.
    radius_ratio_min, radius_ratio_p01, radius_ratio_mean : float
        Smallest value, 1 % quantile and mean of `radius_ratios`.
    angle_min, angle_p01 : float
        Smallest value and 1 % quantile of `minimum_angles`, degrees.
    n_inverted : int
        Number of cells of negative or zero measure.  In a mesh that is inverted as a whole,
        all cells count.  Surface cells have no sign, so only those of zero measure count.
    hausdorff : float or None
        Hausdorff distance to the given surface, to 1 %.
    hausdorff_relative : float or None
        The same over the diagonal of that surface.
    metric : MetricQuality or None
        Quality in the metric and complexity, if a metric was requested.
    at_interfaces : Conformity or None
        Of the cells whose centroid is within two sizes of a place where parts met while `remesh`
        made the mesh; None if there are none.
    served : float or None
        Share of the requested elements at whose place the mean edge of the cell is within a factor
        sqrt 2 of the size.  With a metric, the mean length in the metric.
    too_coarse : float or None
        Share of the requested elements where it is longer.
    worst : WorstPlace or None
        Where the cells are largest compared with the sizes: ``point``, ``size``, ``edge`` (mean of
        the cell) and ``cause``.
    """

    n_points: int
    n_cells: int
    cell_dim: int
    edges: RatioStatistics
    boundary_edges: RatioStatistics | None
    radius_ratio_min: float
    radius_ratio_p01: float
    radius_ratio_mean: float
    angle_min: float
    angle_p01: float
    n_inverted: int
    hausdorff: float | None = None
    hausdorff_relative: float | None = None
    metric: MetricQuality | None = None
    at_interfaces: Conformity | None = None
    served: float | None = None
    too_coarse: float | None = None
    worst: WorstPlace | None = None

    @property
    def share_in_band(self) -> float:
        """Share of all edges with length over size in [1/sqrt 2, sqrt 2]."""
        return self.edges.share_in_band

    @property
    def service(self) -> str:
        """The shares of the requested elements, and the worst place if 1 % of them is missing."""
        text = f"{self.served:.1%} of the requested elements, {self.too_coarse:.1%} too coarse"
        is_off = self.too_coarse is not None and self.too_coarse >= 0.01
        return f"{text}; worst: {self.worst}" if is_off else text

    def as_dict(self) -> dict[str, Any]:
        """Return nested dictionaries of plain numbers (and None), suitable for JSON."""
        return asdict(self)

    def __repr__(self) -> str:
        """Return the number of cells, how well they follow the sizes, and the smallest angle."""
        kind = "tetrahedra" if self.cell_dim == 3 else "triangles"
        served = "" if self.served is None else f", {self.served:.1%} served"
        inverted = f", {self.n_inverted} inverted" if self.n_inverted else ""
        return (
            f"Conformity({self.n_cells} {kind}, {self.share_in_band:.1%} of edges in band{served}, "
            f"smallest angle {self.angle_min:.3g} degrees{inverted})"
        )

    def __str__(self) -> str:
        """Return a small table."""
        kind, angle = ("tetrahedra", "dihedral angle")
        if self.cell_dim == 2:
            kind, angle = ("triangles", "angle")
        lines = [
            f"{self.n_points} points, {self.n_cells} {kind}, {self.n_inverted} inverted",
            "length / size        5 %    25 %    50 %    75 %    95 %    mean  in band     edges",
            _ratio_line("all edges", self.edges),
        ]
        if self.boundary_edges is not None:
            lines.append(_ratio_line("boundary edges", self.boundary_edges))
        if self.served is not None:
            lines.append(f"served: {self.service}")
        lines.append(
            f"radius ratio: min {self.radius_ratio_min:.4f}, 1 % {self.radius_ratio_p01:.4f}, "
            f"mean {self.radius_ratio_mean:.4f}"
        )
        lines.append(f"minimum {angle}: {self.angle_min:.2f} deg, 1 % {self.angle_p01:.2f} deg")
        if self.metric is not None:
            lines.append(str(self.metric))
        if self.hausdorff is not None:
            lines.append(
                f"distance to the surface: {self.hausdorff:.4g} "
                f"({self.hausdorff_relative:.3%} of the diagonal)"
            )
        return "\n".join(lines)


def _ratio_line(name: str, ratio: RatioStatistics) -> str:
    quantiles = (ratio.q05, ratio.q25, ratio.q50, ratio.q75, ratio.q95, ratio.mean)
    columns = " ".join(f"{value:7.3f}" for value in quantiles)
    return f"{name:16} {columns} {ratio.share_in_band:8.2%} {ratio.n_edges:9d}"


def size_conformity(
    mesh: AnyMesh,
    size: SizeLike | Metric | MetricFunction,
    *,
    surface: SimplexMesh | None = None,
) -> Conformity:
    r"""Measure how closely a mesh follows the requested sizes, and the quality of its cells.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
        Triangles or tetrahedra.  Collective for a mesh in parts, of which the whole is measured.
    size : SizeFunction, callable, array_like of float, shape (n_points,), or float
        Requested edge length.  Functions are called with the midpoints of the edges, an
        array of shape (n, dim).  Nodal values belong to ``mesh`` and are averaged.
        Edges with the size inf are ignored.

        Or a metric: a `Metric` at the nodes of ``mesh``, a `MetricFunction` or a callable that
        returns a Metric, called with the nodes.  The ratios are then the lengths of the edges in
        the metric, see `Metric.edge_lengths`.  All its sizes must be finite.

        In parts, functions are called with the nodes, and there are no metrics.
    surface : SimplexMesh, optional
        Reference for the boundary of ``mesh`` (or for ``mesh`` itself, if it has cells of the
        same dimension).  The distance from it is measured.

    Returns
    -------
    Conformity

    Raises
    ------
    ValueError
        If the mesh consists of segments, a size is not positive or NaN or below 1e-60 of an
        edge, no edge has a finite size, or ``surface`` does not fit the mesh.

    Notes
    -----
    Edges that were not made are not counted.  Therefore the requested elements are counted, too:
    :math:`c_d \int h^{-d} \, dx` of them, each equally likely at its place.  One is *served* if
    the mean length of the edges of the cell around it is within a factor sqrt 2 of the size
    there, and the mesh is *too coarse* there if it is longer.  Where the cells are larger than the
    sizes, they are bisected, so that no request is missed if the gradient of the sizes is known.
    Other functions are sampled at the nodes and centroids of the mesh and at the nodes of their
    background.  A metric is measured in the same way, by the mean length of the edges in the metric
    of the place: in the cells of the mesh on which it is given, or if it is a callable, in those of
    ``mesh``.  At most 50 000 nodes are added.  Beyond that, which takes a mesh with far too few
    cells, small sizes may be missed.

    The Hausdorff distance is the larger of the two one-sided distances.  Facets are divided until
    that of the farthest point is known to 1 %.  The whole boundary is used, including cavities, but
    not interfaces between regions.

    Examples
    --------
    The unit square divided into two triangles, with a requested size of 1:

    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> conformity = size_conformity(mesh, 1.0)
    >>> conformity.edges.q50, conformity.share_in_band, round(conformity.angle_min, 6)
    (1.0, 1.0, 45.0)
    """
    mesh = as_mesh("mesh", mesh, PartitionedMesh)
    check_cells(mesh)
    if isinstance(mesh, PartitionedMesh):
        if surface is not None:
            raise ValueError("surface must be None for meshes in parts")
        return _conformity_of_parts(mesh, size)
    if surface is not None:
        surface = as_mesh("surface", surface)
    metric = nodal_metric(mesh, size)
    if metric is None:
        ratio = edge_ratios(mesh, cast(SizeLike, size))
    else:
        ratio = metric.edge_lengths(mesh.points, mesh.edges)
    _refuse_long(ratio)
    found = _conformity(mesh, mesh, ratio, mesh.n_points, boundary_facets(mesh))
    assert found is not None, "a whole mesh has edges"
    if metric is None:
        found = with_served(found, RequestedElements.of(mesh, size).served(size))
    else:
        found = with_served(found, elements_of_metric(mesh, size).served())
    if surface is not None:
        distance = _hausdorff(mesh, surface)
        relative = distance / surface.diagonal if surface.diagonal > 0.0 else np.inf
        found = replace(found, hausdorff=distance, hausdorff_relative=relative)
    return found if metric is None else replace(found, metric=metric_quality(mesh, metric))


def with_served(found: Conformity, served: Served | None) -> Conformity:
    """Return a conformity with the shares of the requested elements."""
    if served is None:
        return found
    return replace(found, served=served.served, too_coarse=served.too_coarse, worst=served.worst)


def elements_of_metric(
    mesh: SimplexMesh, size: Any, max_cells: int | None = None
) -> RequestedElements:
    """Return the elements that a metric, as `size_conformity` takes it, requests in a mesh."""
    function = MetricFunction(mesh, size) if isinstance(size, Metric) else size
    on = function.mesh if isinstance(function, MetricFunction) else None
    if on is not None and on.cell_dim != mesh.cell_dim:
        on = None
    return RequestedElements.of_metric(mesh, function, None if on is mesh else on, max_cells)


def _conformity_of_parts(part: PartitionedMesh, size: object) -> Conformity:
    """Return the conformity of a mesh in parts; collective."""

    def at_nodes() -> FloatArray:
        if isinstance(size, Metric | MetricFunction):
            raise ValueError("size must be sizes for meshes in parts, got a metric")
        return as_sizes_at("size", size, part.points)

    def ratios(mesh: SimplexMesh | None) -> FloatArray:
        if mesh is None:
            return np.empty(0)
        wanted = _size_at_midpoints(mesh, h)
        ratio = np.where(np.isfinite(wanted), mesh.edge_lengths / wanted, np.nan)
        _refuse_long(ratio)
        return ratio

    h = part.ranks.agree(at_nodes)
    ratio = part.ranks.agree(lambda: ratios(part.mesh))
    facets = boundary_facets(part)
    found = _conformity(part, part.mesh, ratio, part.n_global_points, facets)
    if found is None:
        raise ValueError(_NO_SIZE)
    elements = RequestedElements.of(part.mesh, h, ranks=part.ranks)
    found = with_served(found, elements.served(ranks=part.ranks))
    chosen = _at_interfaces(part, h)
    near = SimplexMesh(part.points, part.cells[chosen]) if chosen.any() else None
    used = np.zeros(part.n_points, np.bool_)
    used[part.cells[chosen]] = True
    used = part.shared.merge(used, np.logical_or) & part.is_owned
    n_points = int(part.ranks.allreduce(int(used.sum()), "sum"))
    return replace(found, at_interfaces=_conformity(part, near, ratios(near), n_points))


def _conformity(
    mesh: AnyMesh,
    cells: SimplexMesh | None,
    ratio: FloatArray,
    n_points: int,
    boundary: IntArray | None = None,
) -> Conformity | None:
    """Return the conformity of some cells, None if no edge has a ratio; collective.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
    cells : SimplexMesh or None
        The cells of this rank that count.
    ratio : float64[n_edges]
        Of their edges.
    n_points : int
        Number of their nodes, on all ranks.
    boundary : int32[n, cell_dim], optional
        Facets whose edges are counted apart.
    """
    ranks, none = mesh.ranks, np.empty(0)
    ratios = none if cells is None else radius_ratios(cells)
    angles = none if cells is None else minimum_angles(cells)
    n_inverted = 0 if cells is None else np.count_nonzero(inverted_cells(cells))
    own_edges = np.empty((0, 2), np.int32) if cells is None else cells.edges
    edges = _ratio_statistics(ranks, ratio[is_counted_here(mesh, own_edges)])
    on_boundary = None
    if boundary is not None:
        rows = topology.edges_of(boundary, len(mesh.points))
        rows = rows[is_counted_here(mesh, rows)]
        of_boundary = ratio[topology.rows_among(rows, own_edges)]
        on_boundary = _ratio_statistics(ranks, of_boundary)
    if edges is None:
        return None
    sums = np.array([len(ratios), n_inverted, ratios.sum()])
    n_cells, n_inverted, total = ranks.allreduce(sums, "sum").tolist()
    least = np.array([ratios.min(initial=np.inf), angles.min(initial=np.inf)])
    ratio_min, angle_min = ranks.allreduce(least, "min").tolist()
    return Conformity(
        n_points=n_points,
        n_cells=int(n_cells),
        cell_dim=mesh.cell_dim,
        edges=edges,
        boundary_edges=on_boundary,
        radius_ratio_min=ratio_min,
        radius_ratio_p01=_quantiles(ranks, ratios, (0.01,))[0],
        radius_ratio_mean=total / n_cells,
        angle_min=angle_min,
        angle_p01=_quantiles(ranks, angles, (0.01,))[0],
        n_inverted=int(n_inverted),
    )


def _at_interfaces(part: PartitionedMesh, h: FloatArray) -> BoolArray:
    """Return which cells have their centroid within two sizes of an interface; collective.

    Each rank knows the interfaces of the parts it had.  They go to the ranks whose cells they may
    be near.
    """
    from scipy.spatial import cKDTree

    own = part.once("_former_interfaces", lambda: np.empty((0, part.dim)))
    reach = 2.0 * h[part.cells].mean(axis=1)
    boxes = boxes_of(part)
    widest = np.array(part.ranks.allgather(float(reach.max(initial=0.0))))
    boxes += np.array([-1.0, 1.0])[:, None] * widest[:, None, None]
    which, rank = ranks_within(own, own, boxes, np.full(len(own), np.nextafter(0.0, 1.0)))
    sent = split_rows(own[which], rank, part.ranks.size)
    places = np.concatenate(part.ranks.alltoallv(sent))
    near = np.zeros(part.n_cells, np.bool_)
    if part.n_cells and len(places):
        centroids = part.points[part.cells].mean(axis=1)
        near = cKDTree(places).query(centroids)[0] < reach
    return near


def nodal_metric(mesh: SimplexMesh, size: object, *, finite: bool = True) -> Metric | None:
    """Return a requested metric at the nodes of a mesh, or None for sizes.

    Raises
    ------
    ValueError
        If the metric does not fit the mesh, or a size is inf that must be finite.
    """
    if callable(size) and not isinstance(size, SizeFunction):
        probe = size(mesh.points[:1])
        size = size(mesh.points) if isinstance(probe, Metric) else None
    if not isinstance(size, Metric):
        return None
    size.check_mesh(mesh)
    if finite:
        refuse_where("size", np.isinf(size.sizes), size.sizes, "must be finite in all directions")
    return size


def edge_ratios(mesh: SimplexMesh, size: SizeLike) -> FloatArray:
    """Return the length of each edge over the requested one; NaN where that is inf.

    Raises
    ------
    ValueError
        If a size is not positive or NaN, or no edge has a finite size.
    """
    wanted = _size_at_midpoints(mesh, size)
    finite = np.isfinite(wanted)
    if not finite.any():
        raise ValueError(_NO_SIZE)
    ratio, lengths = np.full(len(wanted), np.nan), mesh.edge_lengths

    def divide(first: int, last: int) -> None:
        chunk = slice(first, last)
        with np.errstate(over="ignore"):
            np.divide(lengths[chunk], wanted[chunk], out=ratio[chunk], where=finite[chunk])

    in_all_threads(divide, len(ratio), _EDGES_AT_ONCE)
    return ratio


def inverted_cells(mesh: SimplexMesh) -> BoolArray:
    """Return whether each cell is flat or inverted; surface cells have no sign."""
    flat = flat_cells(mesh)
    if mesh.cell_dim == mesh.dim:
        flat = flat | (mesh.signed_measures <= 0.0)
    return np.asarray(flat)


def _size_at_midpoints(mesh: SimplexMesh, size: SizeLike) -> FloatArray:
    """Return the checked requested size of each edge."""
    i, j = mesh.edges.T
    if callable(size):
        midpoints = 0.5 * (mesh.points[i] + mesh.points[j])
        return as_sizes("size(midpoints)", size(midpoints), (len(i),))
    nodal = as_sizes_at("size", size, mesh.points)
    sizes = np.empty(len(i))

    def average(first: int, last: int) -> None:
        sizes[first:last] = 0.5 * (nodal[i[first:last]] + nodal[j[first:last]])

    in_all_threads(average, len(i), _EDGES_AT_ONCE)
    return sizes


def _refuse_long(ratio: FloatArray) -> None:
    refuse_where("edges / size", ratio > FARTHEST, ratio, f"must be at most {FARTHEST:g}")


def _ratio_statistics(ranks: Communicator, ratio: FloatArray) -> RatioStatistics | None:
    """Return the statistics of the ratios that are not NaN, or None if there are none."""
    ratio = ratio[~np.isnan(ratio)]
    sums = np.array([len(ratio), np.count_nonzero(is_in_band(ratio)), ratio.sum()])
    n, n_in_band, total = ranks.allreduce(sums, "sum").tolist()
    if n == 0:
        return None
    q05, q25, q50, q75, q95 = _quantiles(ranks, ratio, _QUANTILES)
    return RatioStatistics(int(n), q05, q25, q50, q75, q95, total / n, n_in_band / n)


def _quantiles(ranks: Communicator, values: FloatArray, shares: Sequence[float]) -> list[float]:
    """Return the quantiles of values >= 0 of all ranks, to rounding those of numpy; collective."""
    if ranks.size == 1:
        return [float(q) for q in np.quantile(values, shares)]
    n = ranks.allreduce(len(values), "sum")
    place = np.array(shares) * (n - 1)
    below = np.floor(place)
    both_sides = np.concatenate([below, np.minimum(below + 1.0, n - 1.0)])
    first, second = np.split(values_in_order(ranks, values, both_sides), 2)
    found: list[float] = (first + (place - below) * (second - first)).tolist()
    return found


def _hausdorff(mesh: SimplexMesh, surface: SimplexMesh) -> float:
    """Return the Hausdorff distance of a surface and a mesh's boundary, to 1 %.

    Of a surface around tetrahedra, what bounds the solid counts.
    """
    if mesh.dim != surface.dim or mesh.cell_dim - surface.cell_dim not in (0, 1):
        raise ValueError(
            f"surface must have cells like those of the mesh or of its boundary, "
            f"got {surface!r} for {mesh!r}"
        )
    if mesh.cell_dim == 3 and surface.cell_dim == 2:
        away = distances_from_solid(mesh.boundary().mesh, Solid.of(surface), np.inf)[0]
        return max(found.largest for found in away)
    skin = mesh if mesh.cell_dim == surface.cell_dim else mesh.boundary().mesh
    return max(distances_from(skin, surface).largest, distances_from(surface, skin).largest)
