"""Remeshing of distributed meshes: each rank remeshes its part, then the interfaces move."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize import remeshing
from adaptsize._checks import (
    as_number,
    as_sizes,
    as_tolerance,
    as_whole_number,
    check_type,
    one_of,
    refuse_where,
)
from adaptsize._progress import reporting, silent
from adaptsize.background import SimplexMesh, interpolate
from adaptsize.background.migration import (
    balanced,
    displaced,
    interface_facets,
    migrate,
    number_nodes,
)
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed.interface_quality import InterfaceQuality, measure_interfaces
from adaptsize.errors import BackendError
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# Layers of cells by which interfaces move.  Cells as far as 2 to 3 from an interface suffer from
# its frozen facets.
_LAYERS = 5

# Parts are divided anew in the end if one has more cells than the mean times this.
_IMBALANCE = 1.2

How = Literal["parts", "gather"]


class RemeshedParts(NamedTuple):
    """Result of `distributed.remesh`."""

    part: PartitionedMesh
    """The new mesh."""
    quality: InterfaceQuality
    """Cells at former interfaces, and all cells, compared with the sizes; equal on all ranks."""


@dataclass(frozen=True)
class _Options:
    tolerance: float
    max_elements: float
    timeout: float | None
    progress: ProgressCallback


def remesh(
    part: PartitionedMesh,
    h: npt.ArrayLike,
    *,
    how: How = "parts",
    rounds: int = 2,
    tolerance: float = 1e-3,
    max_elements: float = 5_000_000,
    timeout: float | None = 3600.0,
    progress: ProgressCallback | bool | None = None,
) -> RemeshedParts:
    """Return a new distributed mesh of the same domain with the requested sizes; collective.

    Parameters
    ----------
    part : PartitionedMesh
        Triangles in the plane or tetrahedra.
    h : array_like of float, shape (n_local,)
        Requested edge lengths at the local nodes, finite.  Their gradient is not limited here:
        apply `distributed.limit_gradient` first.
    how : {"parts", "gather"}
        "parts": each rank remeshes its part by Mmg, with the facets between parts frozen.  Then
        parts move, so that these facets lie inside, and the next round begins.
        "gather": rank 0 remeshes the whole mesh and distributes it again.
    rounds : int, default 2
        Number of rounds of "parts".
    tolerance, max_elements, timeout
        As for `adaptsize.remesh`.  ``max_elements`` applies to each rank.
    progress : callable, bool or None

    Returns
    -------
    RemeshedParts
        ``part`` and ``quality``.  Regions, tags and names of tags are those of the old mesh.

    Raises
    ------
    ValueError, BackendError, TooManyElementsError
        On all ranks alike, with the number of the first rank that failed.

    Examples
    --------
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> part = PartitionedMesh.from_serial(square)
    >>> made = remesh(part, np.full(4, 0.1))
    >>> round(float(made.part.mesh.measures.sum()), 9)
    1.0
    """
    check_type("part", part, PartitionedMesh)
    ranks = part.ranks

    def check() -> tuple[FloatArray, str, int, _Options]:
        sizes = as_sizes("h", h, part.nodal_shape)
        refuse_where("h", np.isinf(sizes), sizes, "must be finite")
        options = _Options(
            as_tolerance("tolerance", tolerance),
            as_number("max_elements", max_elements, lower=1.0, allow_inf=True),
            None if timeout is None else as_number("timeout", timeout, lower=0.0, strict=True),
            silent,
        )
        count = as_whole_number("rounds", rounds, lower=1, upper=20)
        if part.cell_dim != part.dim or part.dim < 2:
            raise ValueError("part must consist of triangles in the plane or tetrahedra")
        return sizes, one_of("how", how, ("parts", "gather")), count, options

    sizes, chosen, count, options = ranks.agree(check)
    ranks.require_equal(how=chosen, rounds=count, tolerance=tolerance)
    with reporting(progress if ranks.rank == 0 else None) as report:
        options = replace(options, progress=report)
        if chosen == "gather" or ranks.size == 1:
            new, places = _gathered(part, sizes, options), np.empty((0, part.dim))
        else:
            new, places = _by_parts(part, sizes, count, options)
    return RemeshedParts(new, measure_interfaces(new, interpolate(part, sizes, new.points), places))


def _gathered(part: PartitionedMesh, sizes: FloatArray, options: _Options) -> PartitionedMesh:
    """Return the mesh that rank 0 makes."""
    whole, h = part.gather(), part.gather_nodal(sizes)

    def make() -> SimplexMesh | None:
        if whole is None:
            return None
        made: SimplexMesh = remeshing.remesh(
            whole, h, backend="mmg", tolerance=options.tolerance,
            max_elements=options.max_elements, timeout=options.timeout, progress=options.progress,
        )  # fmt: skip
        return made

    return PartitionedMesh.from_serial(part.ranks.agree(make), None, part.ranks)


def _by_parts(
    part: PartitionedMesh, sizes: FloatArray, rounds: int, options: _Options
) -> tuple[PartitionedMesh, FloatArray]:
    """Return the mesh, and the nodes and middles of all interfaces of the rounds but the last."""
    diagonal = part.diagonal
    work, h = part, sizes
    places: list[FloatArray] = []
    for number in range(rounds):
        if number:
            work = migrate(work, displaced(work, _LAYERS))
            h = interpolate(part, sizes, work.points)
        frozen = interface_facets(work)
        corners = work.points[frozen]
        places += [corners.mean(axis=1), corners.reshape(-1, part.dim)]
        own = work
        made = work.ranks.agree(partial(_remeshed, own, h, frozen, diagonal, options))
        work = _stitched(work, made, frozen)
    if max(work.ranks.allgather(work.n_cells)) * work.ranks.size > _IMBALANCE * work.n_global_cells:
        work = migrate(work, balanced(work))
    return work, np.concatenate(part.ranks.allgather(np.concatenate(places)))


def _remeshed(
    work: PartitionedMesh, h: FloatArray, frozen: IntArray, diagonal: float, options: _Options
) -> SimplexMesh | None:
    """Return a new mesh of the part of this rank; its frozen facets are the same."""
    if work.mesh is None:
        return None
    made: SimplexMesh = remeshing.remesh(
        work.mesh,
        h,
        backend="mmg",
        tolerance=options.tolerance * diagonal / work.mesh.diagonal,
        required_facets=frozen,
        max_elements=options.max_elements,
        timeout=options.timeout,
        progress=options.progress,
    )
    return made


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
    return PartitionedMesh(_with_all_tags(comm, mesh), ids, owner, comm)


def _with_all_tags(comm: Any, mesh: SimplexMesh | None) -> SimplexMesh | None:
    """Return a mesh with empty tagged facets if other parts have some."""
    has = int(mesh is not None and mesh.tagged_facets is not None)
    wanted = comm.allreduce(has, "max")
    if mesh is None or has or not wanted:
        return mesh
    none = np.empty((0, mesh.cell_dim), np.int32)
    return replace(mesh, tagged_facets=none, facet_tags=np.empty(0, np.int32))
