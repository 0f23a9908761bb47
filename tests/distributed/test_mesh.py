"""`PartitionedMesh`: taking a mesh apart, putting it together, and values at shared nodes."""

import numpy as np
import pytest
from meshes import jittered_square
from numpy.testing import assert_allclose, assert_array_equal
from partitions import KINDS, on_ranks, partition
from simulated_ranks import SimulatedCommunicator

from adaptsize import CartesianGrid, SimplexMesh, needs_remeshing, transfer_fields
from adaptsize.background.partitioning import partition_cells
from adaptsize.background.topology import pairs_of_cells
from adaptsize.distributed import PartitionedMesh

MESH = jittered_square(7, 811)
SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("kind", KINDS)
def test_parts_make_up_the_mesh(kind):
    rng = np.random.default_rng(812)
    facets = MESH.facets[::3]
    mesh = SimplexMesh(
        MESH.points,
        MESH.cells,
        cell_tags=rng.integers(1, 4, MESH.n_cells),
        tagged_facets=facets,
        facet_tags=np.arange(len(facets)),
        tag_names={(2, 1): "left"},
        point_data={"u": rng.random((MESH.n_points, 2))},
        cell_data={"k": rng.random(MESH.n_cells)},
    )
    rank_of = partition(mesh, kind, 4, rng)
    results, parts = on_ranks(mesh, rank_of, 4, lambda part: part.gather())
    whole = results[0]
    assert results[1:] == [None] * 3
    for name in ("points", "cells", "cell_tags"):
        assert np.array_equal(getattr(whole, name), getattr(mesh, name))
    assert np.array_equal(whole.point_data["u"], mesh.point_data["u"])
    assert np.array_equal(whole.cell_data["k"], mesh.cell_data["k"])
    order = np.argsort(whole.facet_tags)
    assert np.array_equal(np.sort(whole.tagged_facets[order], axis=1), facets)
    assert whole.tag_names == mesh.tag_names
    assert sum(part.n_cells for part in parts) == mesh.n_cells
    assert sum(part.is_owned.sum() for part in parts) == mesh.n_points
    for part in parts:
        assert np.array_equal(part.points, mesh.points[part.global_ids])
        owned = part.global_ids[part.is_owned]  # also nodes in no cell
        assert np.array_equal(part.global_ids, np.union1d(mesh.cells[part.cell_ids], owned))


@pytest.mark.parametrize("kind", KINDS)
def test_values_at_shared_nodes(kind):
    rank_of = partition(MESH, kind, 5, np.random.default_rng(813))

    def work(part):
        own = np.full(part.n_points, part.ranks.rank + 1.0)
        merged = [merge(own) for merge in (part.sum, part.minimum, part.maximum, part.exchange)]
        nodal = part.scatter_nodal(part.gather_nodal(part.global_ids * 2.0))
        assert np.array_equal(nodal, part.global_ids * 2.0)
        cells = part.gather_cells(part.cell_ids * 3.0)
        assert cells is None or np.array_equal(cells, np.arange(part.n_global_cells) * 3.0)
        return merged

    results, parts = on_ranks(MESH, rank_of, 5, work)
    held = np.zeros((5, MESH.n_points))
    for rank, part in enumerate(parts):
        held[rank, part.global_ids] = rank + 1.0
    expected = (
        held.sum(axis=0),
        np.where(held > 0, held, np.inf).min(axis=0),
        held.max(axis=0),
    )
    for part, merged in zip(parts, results, strict=True):
        for got, whole in zip(merged, expected, strict=False):
            assert np.array_equal(got, whole[part.global_ids])
        assert np.array_equal(merged[3], part.owner + 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"global_ids": [0, 1]}, r"rank 1: global_ids must be 3 integers >= 0, got int64"),
        ({"global_ids": [0, 0, 2]}, "rank 1: global_ids must not repeat a number"),
        ({"owner": [0, 0, 5]}, "rank 1: owner must be a rank from 0 to 1, got 5"),
        ({"mesh": "m"}, "rank 1: mesh must be a SimplexMesh"),
        ({"cell_ids": [-1]}, "rank 1: cell_ids must be 1 integers >= 0"),
    ],
)
def test_bad_input_on_one_rank_is_reported_by_all(change, message):
    def work(comm):
        part = PartitionedMesh.from_serial(SQUARE, [0, 1], comm)
        given = {"mesh": part.mesh, "global_ids": part.global_ids, "owner": part.owner}
        given |= change if comm.rank == 1 else {}
        with pytest.raises(ValueError, match=message):
            PartitionedMesh(comm=comm, **given)

    SimulatedCommunicator.run(2, work)


def test_complex_values_are_gathered_and_scattered():
    rng = np.random.default_rng(817)
    nodal = rng.normal(size=(MESH.n_points, 2)) @ [[1.0, 2.0], [1j, 3.0]]
    by_cell = np.exp(1j * np.arange(MESH.n_cells))

    def run(part):
        own = part.scatter_nodal(nodal if part.ranks.rank == 0 else None)
        assert_array_equal(own, nodal[part.global_ids])
        assert_array_equal(part.exchange(own), own)
        return part.gather_nodal(own), part.gather_cells(by_cell[part.cell_ids])

    found, _ = on_ranks(MESH, None, 3, run)
    assert_array_equal(found[0][0], nodal)
    assert_array_equal(found[0][1], by_cell)


def test_the_cells_of_a_part_are_a_mesh_of_one_rank():
    def run(part):
        if part.ranks.rank != 1:
            return None  # nobody waits for the others
        h = np.full(part.n_points, 0.2)
        need = needs_remeshing(part.mesh, h)
        made = transfer_fields(part.mesh, part.mesh, fields={"u": h}, method="interpolate")
        return need, made.fields["u"]

    need, u = on_ranks(MESH, None, 3, run)[0][1]
    assert 0 < need.n_cells < MESH.n_cells
    assert_allclose(u, 0.2)


def test_a_missing_node_and_a_wrong_owner_are_found():
    def missing(comm):
        part = PartitionedMesh.from_serial(SQUARE, [0, 1], comm)
        with pytest.raises(ValueError, match="global_ids must be all numbers"):
            PartitionedMesh(part.mesh, part.global_ids + 1, part.owner, comm)

    def wrong(comm):
        part = PartitionedMesh.from_serial(SQUARE, [0, 1], comm)
        owner = [1, 0, 0] if comm.rank == 1 else part.owner  # rank 0 does not hold node 3
        return PartitionedMesh(part.mesh, part.global_ids, owner, comm).shared

    SimulatedCommunicator.run(2, missing)
    with pytest.raises(ValueError, match=r"owner must be a rank that holds and owns the node"):
        SimulatedCommunicator.run(2, wrong)


def test_partition_without_metis_is_balanced(monkeypatch):
    monkeypatch.setattr("adaptsize.background.partitioning.find_spec", lambda name: None)
    sizes = np.bincount(partition_cells(MESH, 5))
    assert len(sizes) == 5
    assert np.ptp(sizes) <= 1


@pytest.mark.parametrize("n_parts", [2, 3, 5])
def test_parts_are_compact(n_parts):
    mesh = CartesianGrid((0.0, 0.0), 0.05, (21, 21)).mesh
    part = partition_cells(mesh, n_parts)
    assert np.ptp(np.bincount(part, minlength=n_parts)) <= 0.1 * mesh.n_cells / n_parts
    inner = mesh.facet_cell_counts == 2
    between = part[pairs_of_cells(mesh, inner) // 3]
    assert (between[:, 0] != between[:, 1]).mean() < 0.12
