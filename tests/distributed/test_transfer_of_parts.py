"""Fields between distributed meshes equal those between the whole meshes."""

import numpy as np
import pytest
from scipy.spatial import Delaunay
from simulated_ranks import SimulatedCommunicator

from adaptsize import SimplexMesh, interpolate, transfer_fields
from adaptsize.distributed import PartitionedMesh


def _mesh(dim, n, seed):
    rng = np.random.default_rng(seed)
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * dim)).reshape(dim, -1).T
    points = np.concatenate([corners, rng.random((n, dim))])
    cells = Delaunay(points).simplices
    mesh = SimplexMesh(points, cells)
    return SimplexMesh(points, cells[mesh.measures > 1e-9])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["random", "blocks", "one rank"])
def test_equal_to_the_serial_transfer(dim, kind):
    old, new = _mesh(dim, 60, 9221), _mesh(dim, 50, 9222)
    rng = np.random.default_rng(9223)
    parts = {
        "random": [rng.integers(0, 4, mesh.n_cells) for mesh in (old, new)],
        "blocks": [np.arange(mesh.n_cells) * 4 // mesh.n_cells for mesh in (old, new)],
        "one rank": [np.full(old.n_cells, 1), np.full(new.n_cells, 3)],
    }[kind]
    nodal = {"u": rng.random(old.n_points), "v": rng.random((old.n_points, 2)) * (1 + 2j)}
    by_cell = {"e": rng.random((old.n_cells, 2)), "k": rng.integers(0, 9, old.n_cells)}
    wanted = transfer_fields(old, new, fields=nodal, cell_fields=by_cell)

    def run(comm):
        a = PartitionedMesh.from_serial(old, parts[0], comm)
        b = PartitionedMesh.from_serial(new, parts[1], comm)
        found = transfer_fields(
            a,
            b,
            fields={name: values[a.global_ids] for name, values in nodal.items()},
            cell_fields={name: values[a.cell_ids] for name, values in by_cell.items()},
        )
        return b.global_ids, b.cell_ids, found

    for ids, cell_ids, found in SimulatedCommunicator.run(4, run):
        for name, values in wanted.fields.items():
            assert found.fields[name].dtype == values.dtype
            assert np.abs(found.fields[name] - values[ids]).max(initial=0.0) < 1e-12
        for name, values in wanted.cell_fields.items():
            assert found.cell_fields[name].dtype == values.dtype
            assert np.abs(found.cell_fields[name] - values[cell_ids]).max(initial=0.0) < 1e-12


def test_points_outside_get_the_nearest_value():
    old = _mesh(2, 40, 8108)
    rng = np.random.default_rng(8109)
    places, u = 3.0 * rng.random((200, 2)) - 1.0, rng.random(old.n_points)
    wanted = old.locator.interpolate(u, places)[0]

    def run(comm):
        part = PartitionedMesh.from_serial(old, rng_parts, comm)
        return interpolate(part, u[part.global_ids], places)

    rng_parts = rng.integers(0, 3, old.n_cells)
    for found in SimulatedCommunicator.run(3, run):
        assert np.abs(found - wanted).max() < 1e-12


def test_wrong_field_on_one_rank_is_reported_by_all():
    old = _mesh(2, 20, 31)

    def run(comm):
        part = PartitionedMesh.from_serial(old, None, comm)
        u = np.zeros(part.n_points + (comm.rank == 1))
        with pytest.raises(ValueError, match=r"rank 1: fields\['u'\] must have"):
            transfer_fields(part, part, fields={"u": u})

    SimulatedCommunicator.run(2, run)


def test_conservative_that_is_no_flag_is_refused():
    part = PartitionedMesh.from_serial(_mesh(2, 20, 31))
    with pytest.raises(ValueError, match="conservative must be True or False, got 'no'"):
        transfer_fields(part, part, conservative="no")


def test_whole_numbers_are_interpolated_as_floats():
    part = PartitionedMesh.from_serial(_mesh(2, 10, 9227))
    values = np.arange(part.n_points)
    found = interpolate(part, values, [[0.3, 0.4], [0.5, 0.6]])
    np.testing.assert_array_equal(
        found, interpolate(part, values.astype(float), [[0.3, 0.4], [0.5, 0.6]])
    )
    assert found.dtype == np.float64
