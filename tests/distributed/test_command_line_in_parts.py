"""``limit`` and ``remesh`` on PVTU files and on several ranks of MPI."""

import re
from pathlib import Path

import numpy as np
import pytest
from real_ranks import numbers_of_ranks, run_on_ranks
from simulated_ranks import SimulatedCommunicator

from adaptsize import CartesianGrid, SimplexMesh, limit_gradient, write
from adaptsize.cli.entry import main
from adaptsize.distributed.files import read_parts, write_parts

FAILING = Path(__file__).with_name("failing_rank.py")


RANKS = numbers_of_ranks()[-1]
PIECES = 4


def _cut_box(dim):
    """Return a square or cube without one of its corners, and bounds at its nodes."""
    n = 9 if dim == 2 else 5
    box = CartesianGrid((0.0,) * dim, 1.0 / (n - 1), (n,) * dim).mesh
    kept = box.cells[~(box.points[box.cells].mean(axis=1) > 0.5).all(axis=1)]
    nodes, cells = np.unique(kept, return_inverse=True)
    points = box.points[nodes]
    h0 = np.full(len(points), 0.3)
    h0[np.linalg.norm(points - np.eye(dim)[0], axis=1) == 0.0] = 0.05
    return SimplexMesh(points, cells.reshape(kept.shape)), h0


@pytest.fixture(scope="module", params=[2])
def mesh(request, tmp_path_factory):
    """Return the path of a file of several pieces, and the mesh."""
    folder = tmp_path_factory.mktemp("parts")
    whole, h0 = _cut_box(request.param)
    write(folder / "whole.vtu", whole, fields={"h0": h0})
    path = folder / "mesh.vtkhdf"
    SimulatedCommunicator.run(
        PIECES, lambda comm: write_parts(path, read_parts(folder / "whole.vtu", comm))
    )
    return path, whole.with_data(point_data={"h0": h0})


def _mpi(n_ranks, *arguments, script=("-m", "adaptsize")):
    return run_on_ranks(n_ranks, *script, *arguments, timeout=120)


def _read(path):
    return SimulatedCommunicator.run(1, lambda comm: read_parts(path, comm))[0].mesh


@pytest.mark.parametrize(("mesh", "output"), [(2, "a.vtkhdf")], indirect=["mesh"])
def test_ranks_write_what_one_process_writes(mesh, tmp_path, output):
    path, whole = mesh
    done = _mpi(RANKS, "limit", path, "--field", "h0", "-g", 0.2, "-o", tmp_path / output)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].endswith(f"of {whole.n_points} nodes lowered, on {RANKS} ranks")
    assert len(lines) == 2  # only one rank prints
    found = _read(tmp_path / output)
    assert np.array_equal(found.points, whole.points)
    assert np.array_equal(found.point_data["h"], limit_gradient(whole, whole.point_data["h0"], 0.2))


def test_one_process_takes_the_file_of_all_ranks(mesh, tmp_path):
    path, whole = mesh
    output = str(tmp_path / "a.vtu")
    with pytest.raises(SystemExit) as end:
        main(["limit", str(path), "--field", "h0", "-g", "0.2", "-o", output])
    assert end.value.code == 0
    expected = limit_gradient(whole, whole.point_data["h0"], 0.2)
    assert np.array_equal(_read(output).point_data["h"], expected)


def test_remeshing_on_several_ranks(mesh, tmp_path):
    output = tmp_path / "fine.vtkhdf"
    done = _mpi(RANKS, "remesh", mesh[0], "--field", "h0", "-g", 0.2, "-o", output)
    assert done.returncode == 0, done.stderr
    assert "at interfaces" in done.stdout
    found = _read(output)
    assert found.measures.sum() == pytest.approx(0.75, abs=1e-9)
    assert found.boundary().mesh.measures.sum() == pytest.approx(4.0, abs=1e-9)
    assert np.abs(found.point_data["h"]).max() < 0.31


@pytest.mark.parametrize(("phase", "rank"), [("writing", 1), ("killed", 0)])
def test_fault_on_one_rank_ends_all(mesh, tmp_path, phase, rank):
    command = ("limit", mesh[0], "--field", "h0", "-g", 0.2, "-o", tmp_path / "a.vtkhdf")
    done = _mpi(RANKS, *command, script=(str(FAILING), phase, str(rank)))
    assert done.returncode != 0
    errors = [line for line in done.stderr.splitlines() if "adaptsize: error" in line]
    if phase == "killed":  # mpiexec ends the others and reports the signal
        assert re.search(r"(?i)signal:?\s+9", done.stdout + done.stderr)
    else:
        assert done.returncode == 1
        assert errors == [f"adaptsize: error: rank {rank}: planted fault"]
    assert not (tmp_path / "a.vtkhdf").exists()
