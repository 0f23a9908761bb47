"""Cells that move between ranks, and the interfaces between parts."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_ranks import SimulatedCommunicator

from adaptsize import CartesianGrid
from adaptsize.background.migration import balanced, displaced, interface_facets, migrate
from adaptsize.distributed import PartitionedMesh


def _square(n):
    mesh = CartesianGrid((0.0, 0.0), 1.0 / (n - 1), (n, n)).mesh
    edges = mesh.boundary()
    return replace(
        mesh,
        cell_tags=(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5).astype(int),
        tagged_facets=edges.nodes[edges.mesh.cells],
        facet_tags=np.arange(len(edges.cells)),
        point_data={"x": mesh.points[:, 0]},
        cell_data={"number": np.arange(mesh.n_cells)},
    )


def _keys(mesh, rows):
    """Return facets by the coordinates of their nodes, which no numbering changes."""
    return {tuple(sorted(map(tuple, mesh.points[row].tolist()))) for row in rows}


@pytest.mark.parametrize("seed", range(3))
def test_migration_keeps_the_mesh(seed):
    mesh = _square(7)
    rng = np.random.default_rng(5190 + seed)
    n_ranks = 4
    before, after = rng.integers(0, n_ranks, (2, mesh.n_cells))
    after[after == 2] = 1  # a rank without cells

    def run(comm):
        part = PartitionedMesh.from_serial(mesh, before, comm)
        moved = migrate(part, after[part.cell_ids])
        held = moved.n_cells, moved.cells if moved.mesh is None else moved.mesh.cell_data["number"]
        return moved.gather(), held

    results = SimulatedCommunicator.run(n_ranks, run)
    whole = results[0][0]
    assert np.array_equal(whole.points, mesh.points)
    order = np.argsort(whole.cell_data["number"])
    assert np.array_equal(whole.cells[order], mesh.cells)
    assert np.array_equal(whole.cell_tags[order], mesh.cell_tags)
    assert np.array_equal(whole.point_data["x"], mesh.points[:, 0])
    tags = dict(zip(map(tuple, np.sort(mesh.tagged_facets, axis=1)), mesh.facet_tags, strict=True))
    assert tags == dict(
        zip(map(tuple, np.sort(whole.tagged_facets, axis=1)), whole.facet_tags, strict=True)
    )
    for rank, (_, (n_cells, numbers)) in enumerate(results):
        assert n_cells == np.count_nonzero(after == rank)
        assert (after[np.ravel(numbers)] == rank).all()


@pytest.mark.parametrize("seed", range(3))
def test_interface_facets_are_those_between_cells_of_two_ranks(seed):
    mesh = _square(6)
    ranks = np.random.default_rng(771 + seed).integers(0, 3, mesh.n_cells)
    lowest, highest = np.full(len(mesh.facets), 9), np.full(len(mesh.facets), -1)
    np.minimum.at(lowest, mesh.cell_facets, ranks[:, None])
    np.maximum.at(highest, mesh.cell_facets, ranks[:, None])

    def run(comm):
        part = PartitionedMesh.from_serial(mesh, ranks, comm)
        return _keys(part, interface_facets(part))

    for rank, found in enumerate(SimulatedCommunicator.run(3, run)):
        own = (lowest != highest) & ((lowest == rank) | (highest == rank))
        assert found == _keys(mesh, mesh.facets[own])


def test_displacement_puts_interfaces_inside():
    mesh = _square(25)
    x = mesh.points[mesh.cells].mean(axis=1)
    ranks = np.where(x[:, 0] < 0.5, np.where(x[:, 1] < 0.4, 0, 1), 2)

    def run(comm):
        part = PartitionedMesh.from_serial(mesh, ranks, comm)
        moved = migrate(part, displaced(part, 3))
        return *(_keys(p, interface_facets(p)) for p in (part, moved)), part.n_cells, moved.n_cells

    results = SimulatedCommunicator.run(3, run)
    before, after = (set().union(*(r[k] for r in results)) for k in (0, 1))
    assert len(before) > 30
    assert len(before & after) <= 1  # where a new interface crosses an old one
    # The part with the fewest cells grows into the others, that with the most gives some to both.
    growth = {old: new - old for _, _, old, new in results}
    assert growth[min(growth)] > 50
    assert growth[max(growth)] < -50
    # Only cells within three layers of an interface change their rank.
    assert sum(map(abs, growth.values())) < 2 * 3 * 2 * len(before)
    alone = SimulatedCommunicator.run(
        1, lambda comm: displaced(PartitionedMesh.from_serial(mesh, None, comm), 3)
    )
    assert (alone[0] == 0).all()


@pytest.mark.parametrize("shift", [0.0, -30.0, 1e3])
def test_balanced_parts_have_about_the_same_number_of_cells(shift):
    mesh = _square(25)
    mesh = mesh.moved(mesh.points + shift)

    def run(comm):
        part = PartitionedMesh.from_serial(mesh, np.zeros(mesh.n_cells, int), comm)
        return migrate(part, balanced(part)).n_cells

    counts = SimulatedCommunicator.run(3, run)
    assert sum(counts) == mesh.n_cells
    assert max(counts) - min(counts) < 0.03 * mesh.n_cells
