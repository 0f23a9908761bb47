"""Division of a mesh into parts, and the mesh that parts make up."""

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_plain_array, of_type
from adaptsize.background._curve import along_curve
from adaptsize.background.simplex import SimplexMesh
from adaptsize.background.topology import places_among, unique_rows
from adaptsize.ranks import Ids
from adaptsize.typing import BoolArray, IntArray


class RankPart(NamedTuple):
    """The part of one rank."""

    mesh: SimplexMesh | None
    global_ids: Ids
    owner: IntArray
    cell_ids: Ids


def parts_of(mesh: SimplexMesh | None, parts: npt.ArrayLike | None, size: int) -> list[RankPart]:
    """Return the parts of a mesh for all ranks."""
    mesh = of_type("mesh", mesh, SimplexMesh)
    rank_of = _rank_of_cells(mesh, parts, size)
    n = mesh.n_points
    owner = np.full(n, size, np.int32)
    np.minimum.at(owner, mesh.cells, rank_of[:, None])
    owner[owner == size] = rank_of.min()
    return [cut_part(mesh, rank_of, owner, rank) for rank in range(size)]


def _rank_of_cells(mesh: SimplexMesh, parts: npt.ArrayLike | None, size: int) -> IntArray:
    given = as_plain_array("parts", size if parts is None else parts)
    if given.dtype.kind in "iu" and given.ndim == 0 and 1 <= given <= size:
        return partition_cells(mesh, int(given))
    if given.dtype.kind not in "iu" or given.shape != (mesh.n_cells,):
        raise ValueError(
            f"parts must be a number from 1 to {size}, or the rank of each of {mesh.n_cells} "
            f"cells, got {given.dtype} of shape {given.shape}"
        )
    if given.min() < 0 or given.max() >= size:
        raise ValueError(
            f"parts must be ranks from 0 to {size - 1}, got {given.min()} to {given.max()}"
        )
    return given.astype(np.int32)


def cut_part(mesh: SimplexMesh, rank_of: IntArray, owner: IntArray, rank: int) -> RankPart:
    """Return the part of one rank, nodes and cells in the order of the whole mesh."""
    cell_ids = np.flatnonzero(rank_of == rank)
    if len(cell_ids) == 0:
        return RankPart(None, cell_ids, np.empty(0, np.int32), cell_ids)
    held = owner == rank
    held[mesh.cells[cell_ids]] = True
    nodes = np.flatnonzero(held)
    local = places_among(nodes, mesh.n_points)
    facets = tags = None
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        inside = _are_facets(local[mesh.cells[cell_ids]], local[mesh.tagged_facets], len(nodes))
        facets, tags = local[mesh.tagged_facets[inside]], mesh.facet_tags[inside]
    piece = SimplexMesh(
        mesh.points[nodes],
        local[mesh.cells[cell_ids]],
        cell_tags=None if mesh.cell_tags is None else mesh.cell_tags[cell_ids],
        tagged_facets=facets,
        facet_tags=tags,
        tag_names=mesh.tag_names,
        point_data={name: values[nodes] for name, values in mesh.point_data.items()},
        cell_data={name: values[cell_ids] for name, values in mesh.cell_data.items()},
    )
    return RankPart(piece, nodes, owner[nodes], cell_ids)


def _are_facets(cells: IntArray, facets: IntArray, n: int) -> BoolArray:
    """Return which facets, given by their nodes with -1 for others, belong to a cell."""
    inside: BoolArray = np.all(facets >= 0, axis=1)
    own = [np.delete(cells, v, axis=1) for v in range(cells.shape[1])]
    number = unique_rows(np.concatenate([*own, facets[inside]]), n)[1]
    inside[inside] = np.isin(number[cells.size :], number[: cells.size])
    return inside


def joined(pieces: Sequence[tuple[SimplexMesh | None, Ids, Ids]]) -> SimplexMesh:
    """Return the mesh of which parts are given, with their global numbers of nodes and cells."""
    held = [piece for piece in pieces if piece[0] is not None]
    meshes: list[Any] = [piece[0] for piece in held]
    first = meshes[0]
    n = 1 + max(int(ids.max()) for _, ids, _ in held)
    order = np.argsort(np.concatenate([numbers for _, _, numbers in held]), kind="stable")
    ids = [ids for _, ids, _ in held]
    cells = [ids[k][mesh.cells] for k, mesh in enumerate(meshes)]
    facets = tags = None
    if first.tagged_facets is not None:
        rows = np.concatenate([ids[k][mesh.tagged_facets] for k, mesh in enumerate(meshes)])
        once = np.unique(np.sort(rows, axis=1), axis=0, return_index=True)[1]
        facets = rows[np.sort(once)]
        tags = np.concatenate([mesh.facet_tags for mesh in meshes])[np.sort(once)]
    cell_tags = None
    if first.cell_tags is not None:
        cell_tags = np.concatenate([mesh.cell_tags for mesh in meshes])[order]

    def nodal(arrays: list[npt.NDArray[Any]]) -> npt.NDArray[Any]:
        whole = np.empty((n, *arrays[0].shape[1:]), arrays[0].dtype)
        for own, values in reversed(list(zip(ids, arrays, strict=True))):
            whole[own] = values
        return whole

    return SimplexMesh(
        nodal([mesh.points for mesh in meshes]),
        np.concatenate(cells)[order],
        cell_tags=cell_tags,
        tagged_facets=facets,
        facet_tags=tags,
        tag_names={key: name for mesh in meshes for key, name in mesh.tag_names.items()},
        point_data={k: nodal([mesh.point_data[k] for mesh in meshes]) for k in first.point_data},
        cell_data={
            k: np.concatenate([mesh.cell_data[k] for mesh in meshes])[order]
            for k in first.cell_data
        },
    )


def partition_cells(mesh: SimplexMesh, n_parts: int) -> IntArray:
    """Return the part of each cell, 0 to n_parts - 1: connected parts of nearly equal size.

    METIS is used if ``pymetis`` 2025.2 or later is installed.  Otherwise the cells along a Morton
    curve are cut into pieces of equal length.
    """
    if n_parts < 2 or mesh.n_cells <= n_parts:
        return np.arange(mesh.n_cells, dtype=np.int32) % n_parts
    if find_spec("pymetis") is not None:
        import pymetis

        if hasattr(pymetis, "CSRAdjacency"):
            return _by_metis(mesh, n_parts)
    order = along_curve(np.ascontiguousarray(mesh.points[mesh.cells].mean(axis=1)))
    part = np.empty(mesh.n_cells, np.int32)
    part[order] = np.arange(mesh.n_cells) * n_parts // mesh.n_cells
    return part


def _by_metis(mesh: SimplexMesh, n_parts: int) -> IntArray:
    """Return the parts that METIS finds in the graph of cells with a common facet."""
    import pymetis
    from scipy.sparse import csr_array

    n_facets = len(mesh.facets)
    rows = np.repeat(np.arange(mesh.n_cells), mesh.cells.shape[1])
    incidence = csr_array(
        (np.ones(len(rows), np.int8), (rows, mesh.cell_facets.ravel())),
        shape=(mesh.n_cells, n_facets),
    )
    graph = (incidence @ incidence.T).tocsr()
    graph.setdiag(0)
    graph.eliminate_zeros()
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    found = pymetis.part_graph(n_parts, adjacency)
    return np.asarray(found[1], np.int32)
