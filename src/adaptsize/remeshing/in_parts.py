"""Remeshing of meshes in parts: each rank remeshes its part, then the interfaces move."""

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_sizes_at, count_text, one_of, refuse_where
from adaptsize._defaults import refused_above
from adaptsize._messages import Message
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
from adaptsize.errors import BackendError, TooManyElementsError
from adaptsize.options import RemeshOptions
from adaptsize.remeshing import tuning
from adaptsize.sizes.budget import calibration, count_elements
from adaptsize.typing import FloatArray, IntArray

#: Returns a new mesh of a whole mesh, as `adaptsize.remesh`.
Remesh = Callable[..., SimplexMesh]


def remesh_parts(
    part: PartitionedMesh, size: npt.ArrayLike, remesh: Remesh, given: RemeshOptions
) -> PartitionedMesh:
    """Return a new mesh by checked options; collective.  ``remesh`` makes that of one part."""
    ranks = part.ranks

    def check() -> FloatArray:
        h = as_sizes_at("size", size, part.points)
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
    _refuse_too_many(part, h, refused_above(given["max_elements"]))
    if given["how"] == "gather" or ranks.size == 1:
        new, places = _gathered(part, h, remesh), np.empty((0, part.dim))
    else:
        new, places = _by_parts(part, h, remesh, given)
    new.once("_former_interfaces", lambda: places)
    return new


def _refuse_too_many(part: PartitionedMesh, sizes: FloatArray, most: float) -> None:
    """Raise on all ranks if too many elements are predicted in all parts together; collective."""
    count = calibration("mmg", part.cell_dim) * count_elements(part, sizes)
    if count > most:
        text = (
            "the sizes require about {} elements, more than {max_elements} = {:.0f}; increase "
            "the sizes or raise {max_elements}"
        )
        raise TooManyElementsError(Message(text, count_text(count), most), count)


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
            work = migrate(work, displaced(work, tuning.LAYERS))
            h = interpolate(part, sizes, work.points)
        frozen = interface_facets(work)
        corners = work.points[frozen]
        places += [corners.mean(axis=1), corners.reshape(-1, part.dim)]
        allowed = given["tolerance"] * part.diagonal
        made = work.ranks.agree(partial(_remeshed, work, h, frozen, allowed, remesh))
        work = _stitched(work, made, frozen)
    if (
        max(work.ranks.allgather(work.n_cells)) * work.ranks.size
        > tuning.IMBALANCE * work.n_global_cells
    ):
        work = migrate(work, balanced(work))
    return work, np.concatenate(places)


def _remeshed(
    work: PartitionedMesh, h: FloatArray, frozen: IntArray, allowed: float, remesh: Remesh
) -> SimplexMesh | None:
    """Return a new mesh of the part of this rank; its frozen facets are the same."""
    if work.mesh is None:
        return None
    tolerance = min(1.0, allowed / work.mesh.diagonal)
    return remesh(work.mesh, h, required_facets=frozen, tolerance=tolerance, max_elements=np.inf)


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
