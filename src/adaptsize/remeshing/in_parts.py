"""Remeshing of meshes in parts: each rank remeshes its part, then the interfaces move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_float_array,
    as_sizes,
    check_type,
    one_of,
    refuse_where,
)
from adaptsize.background import SimplexMesh, interpolate
from adaptsize.background.migration import (
    balanced,
    displaced,
    interface_facets,
    migrate,
    number_nodes,
    with_common_tags,
)
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.background.requests import boxes_of, ranks_within
from adaptsize.errors import BackendError
from adaptsize.options import RemeshOptions
from adaptsize.quality.elements import minimum_angles
from adaptsize.ranks import split_rows
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Parts are divided anew in the end if one has more cells than the mean times this.
_IMBALANCE = 1.2

#: Returns a new mesh of a whole mesh, as `adaptsize.remesh`.
Remesh = Callable[..., SimplexMesh]


def remesh_parts(
    part: PartitionedMesh, size: npt.ArrayLike, remesh: Remesh, given: RemeshOptions
) -> PartitionedMesh:
    """Return a new mesh by checked options; collective.  ``remesh`` makes that of one part."""
    ranks = part.ranks

    def check() -> FloatArray:
        values = size(part.points) if callable(size) else size
        h = as_float_array("size", values)
        h = as_sizes("size", np.full(part.n_points, h) if h.ndim == 0 else h, part.nodal_shape)
        refuse_where("size", np.isinf(h), h, "must be finite")
        if part.cell_dim != part.dim or part.dim < 2:
            raise ValueError("part must consist of triangles in the plane or tetrahedra")
        one_of("backend", given["backend"], ("auto", "mmg"))
        one_of("target", given["target"], ("auto", "tetrahedra" if part.dim == 3 else "triangles"))
        return h

    h = ranks.agree(check)
    by_name = {name: given[name] for name in ("how", "rounds", "tolerance")}
    ranks.require_equal(**by_name)
    part.require_equal_values("size", h)
    if given["how"] == "gather" or ranks.size == 1:
        new, places = _gathered(part, h, remesh), np.empty((0, part.dim))
    else:
        new, places = _by_parts(part, h, remesh, given)
    new.once("_former_interfaces", lambda: places)
    return new


def _gathered(part: PartitionedMesh, sizes: FloatArray, remesh: Remesh) -> PartitionedMesh:
    """Return the mesh that rank 0 makes."""
    whole, h = part.gather(), part.gather_nodal(sizes)
    new = part.ranks.agree(lambda: None if whole is None else remesh(whole, h))
    return PartitionedMesh.from_serial(new, None, part.ranks)


def _by_parts(
    part: PartitionedMesh, sizes: FloatArray, remesh: Remesh, given: RemeshOptions
) -> tuple[PartitionedMesh, FloatArray]:
    """Return the mesh, and the nodes and middles of the interfaces that this rank has frozen."""
    work, h = part, sizes
    places: list[FloatArray] = []
    for number in range(given["rounds"]):
        if number:
            # Cells as far as 2 to 3 layers from an interface suffer from its frozen facets.
            work = migrate(work, displaced(work, 5))
            h = interpolate(part, sizes, work.points)
        frozen = interface_facets(work)
        corners = work.points[frozen]
        places += [corners.mean(axis=1), corners.reshape(-1, part.dim)]
        allowed = given["tolerance"] * part.diagonal
        made = work.ranks.agree(partial(_remeshed, work, h, frozen, allowed, remesh))
        work = _stitched(work, made, frozen)
    if max(work.ranks.allgather(work.n_cells)) * work.ranks.size > _IMBALANCE * work.n_global_cells:
        work = migrate(work, balanced(work))
    return work, np.concatenate(places)


def _remeshed(
    work: PartitionedMesh, h: FloatArray, frozen: IntArray, allowed: float, remesh: Remesh
) -> SimplexMesh | None:
    """Return a new mesh of the part of this rank; its frozen facets are the same."""
    if work.mesh is None:
        return None
    return remesh(work.mesh, h, required_facets=frozen, tolerance=allowed / work.mesh.diagonal)


def _stitched(old: PartitionedMesh, mesh: SimplexMesh | None, frozen: IntArray) -> PartitionedMesh:
    """Return the new meshes of the parts as one mesh.

    Frozen nodes have the same coordinates, bit for bit, and keep their numbers.
    """
    comm = old.ranks
    n_new = comm.allgather(0 if mesh is None else mesh.n_points)
    keys = old.n_global_points + sum(n_new[: comm.rank]) + np.arange(n_new[comm.rank])

    def match() -> None:
        if mesh is None:
            return
        nodes = np.unique(old.shared.every)
        rows = {point.tobytes(): i for i, point in enumerate(mesh.points + 0.0)}
        on_frozen = np.isin(nodes, frozen)
        for node, is_frozen in zip(nodes.tolist(), on_frozen.tolist(), strict=True):
            row = rows.get((old.points[node] + 0.0).tobytes())
            if row is not None:
                keys[row] = old.global_ids[node]
            elif is_frozen:
                raise BackendError("mmg moved a node between two parts")

    _ = old.shared  # collective
    comm.agree(match)
    ids, owner = number_nodes(comm, keys)
    return PartitionedMesh(with_common_tags(comm, mesh), ids, owner, comm)


@dataclass(frozen=True)
class Quality:
    """Some cells and edges of a mesh compared with the requested sizes."""

    n_cells: int
    share_in_band: float
    """Share of the edges of these cells within a factor sqrt 2 of the size; nan without cells.
    An edge counts once for each of its cells."""
    angle_min: float
    """Smallest angle of `minimum_angles` in degrees; nan without cells."""
    angle_p01: float
    """Its quantile of 1 %; the smallest of those of the parts."""

    def __str__(self) -> str:
        """Return the numbers on one line."""
        return (
            f"{self.n_cells} cells, {self.share_in_band:.1%} of the edges in the band, least "
            f"angle {self.angle_min:.1f} degrees, 1 % below {self.angle_p01:.1f}"
        )


@dataclass(frozen=True)
class InterfaceQuality:
    """The quality of all cells, and of those at former interfaces."""

    everywhere: Quality
    at_interfaces: Quality
    """Of cells whose centroid is within two sizes of an interface of an earlier round."""

    def __str__(self) -> str:
        """Return a line for all cells, and one for those at interfaces, if there are any."""
        return "\n".join(
            f"{name:14}{q}"
            for name, q in (("all cells", self.everywhere), ("at interfaces", self.at_interfaces))
            if q.n_cells
        )


def interface_quality(part: PartitionedMesh, h: npt.ArrayLike) -> InterfaceQuality:
    """Return the quality of a mesh, everywhere and where parts met when it was made; collective.

    Parameters
    ----------
    part : PartitionedMesh
        For instance one that `adaptsize.remesh` has returned, which knows its former interfaces.
    h : array_like of float, shape (n_local,)
        Requested sizes at its nodes.

    Returns
    -------
    InterfaceQuality
        The same on all ranks.

    Examples
    --------
    >>> from adaptsize import remesh
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> fine = remesh(PartitionedMesh.from_serial(square), 0.1)
    >>> interface_quality(fine, np.full(fine.n_points, 0.1)).everywhere.share_in_band > 0.8
    True
    """
    check_type("part", part, PartitionedMesh)
    h = part.ranks.agree(lambda: as_sizes("h", h, part.nodal_shape))
    every = np.ones(part.n_cells, bool)
    return InterfaceQuality(_quality(part, h, every), _quality(part, h, _at_interfaces(part, h)))


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
    near = np.zeros(part.n_cells, bool)
    if part.n_cells and len(places):
        centroids = part.points[part.cells].mean(axis=1)
        near = cKDTree(places).query(centroids)[0] < reach
    return near


def _quality(part: PartitionedMesh, h: FloatArray, chosen: BoolArray) -> Quality:
    n_edges = n_good = 0
    least = p01 = np.inf
    if part.mesh is not None and chosen.any():
        cells = part.cells[chosen]
        for v in range(cells.shape[1]):
            for w in range(v):
                i, j = cells[:, v], cells[:, w]
                length = np.linalg.norm(part.points[i] - part.points[j], axis=1)
                ratio = length / (0.5 * (h[i] + h[j]))
                n_edges += len(ratio)
                n_good += int(np.count_nonzero(np.abs(np.log(ratio)) <= 0.5 * np.log(2.0)))
        angles = minimum_angles(part.mesh)[chosen]
        least, p01 = float(angles.min()), float(np.quantile(angles, 0.01))
    total = part.ranks.allreduce(np.array([np.count_nonzero(chosen), n_edges, n_good]), "sum")
    least, p01 = part.ranks.allreduce(np.array([least, p01]), "min").tolist()
    if total[0] == 0:
        return Quality(0, np.nan, np.nan, np.nan)
    return Quality(int(total[0]), float(total[2] / total[1]), least, p01)
