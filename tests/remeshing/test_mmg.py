"""The loop around Mmg, with a generator of the test's own in its place."""

from dataclasses import replace

import numpy as np
import pytest
from fake_generators import FakeBackend
from meshes import jittered_square

from adaptsize import CartesianGrid, SimplexMesh, check_mesh, remesh, size_conformity
from adaptsize.background.bisection import resolved
from adaptsize.errors import BackendError, ResolutionWarning
from adaptsize.remeshing import register_backend, registry, tuning
from adaptsize.remeshing.mmg import MmgBackend, adapted, job_of
from adaptsize.remeshing.preparation import as_problem


def test_coincident_nodes_in_a_result_are_no_division_by_zero():
    problem = as_problem("plane triangles", jittered_square(4, 7), 1e-3)
    problem = replace(problem, size=lambda points: np.full(len(points), 0.3))
    n_runs = 0

    def collapse(function, text, arrays, options):
        nonlocal n_runs
        n_runs += 1
        points = np.array(arrays["points"])
        points[arrays["cells"][: -1 if n_runs == 1 else None]] = points[0]
        return {**arrays, "points": points}

    made = MmgBackend().solve(problem, collapse)
    assert n_runs == 3
    assert len(made["cells"]) == problem.mesh.n_cells


@pytest.mark.parametrize("dim", [2, 3])
def test_mmg_runs_again_while_requested_elements_are_missing(dim):
    # The input is resolved to a small ball.  The first result has right edges, but none in it.
    whole, least = CartesianGrid([0.0] * dim, 0.5, (3,) * dim).mesh, 0.02

    def size(points, least=least):
        return least + 0.25 * np.linalg.norm(points - 0.3, axis=1)

    fine = resolved(whole, size, g=0.25, factor=1.9, accuracy=0.0).mesh
    coarse = resolved(whole, lambda x: size(x, 0.1), g=0.25, factor=1.9, accuracy=0.0).mesh
    task = "tetrahedra" if dim == 3 else "plane triangles"
    problem = replace(as_problem(task, fine, 1e-3), size=size)
    results = iter([coarse, fine, coarse])
    n_runs = 0

    def run(function, text, arrays, options):
        nonlocal n_runs
        n_runs += 1
        return job_of(as_problem(task, next(results), 1e-3))[0]

    made = adapted(problem, [1.0] * 3, run)
    assert size_conformity(coarse, size).served < 0.6 < size_conformity(fine, size).served
    assert len(made["cells"]) == fine.n_cells
    assert n_runs >= 2


def test_a_lost_request_is_warned_of():
    class Idle(FakeBackend):
        def solve(self, problem, run):
            # The given mesh, without the nodes at the small size.
            return {"points": problem.mesh.points[: mesh.n_points], "cells": mesh.cells}

    mesh = CartesianGrid([0.0] * 3, 0.25, (5, 5, 5)).mesh

    def size(points):
        return np.minimum(0.01 + 0.25 * np.linalg.norm(points - 0.5, axis=1), 0.25)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "_BACKENDS", dict(registry._BACKENDS))
        register_backend(Idle("none"))
        with pytest.warns(ResolutionWarning, match="requested elements are missing") as seen:
            remesh(mesh, size, backend="fake")
        assert [warning.filename for warning in seen] == [__file__]
        assert "edges of 0.315 where the size 0.01" in str(seen[0].message)
        remesh(mesh, 0.25, backend="fake")  # a right one is not warned of


def test_cells_with_nodes_out_of_range_are_an_error_of_mmg():
    def lying(function, text, arrays, options):
        return {"points": np.zeros((3, 2)), "cells": np.array([[0, 1, 3]], np.int32)}

    mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    problem = replace(as_problem("plane triangles", mesh, 0.1), size=lambda x: np.ones(len(x)))
    with pytest.raises(BackendError, match="mmg returned cells whose nodes do not exist"):
        MmgBackend().solve(problem, lying)


@pytest.mark.parametrize(("n_sides", "size"), [(24, 0.2), (60, 0.2), (120, 0.3)])
def test_a_polygon_is_rounded_by_no_more_than_twice_the_tolerance(n_sides, size):
    pytest.importorskip("mmgpy")
    angle = 2.0 * np.pi * np.arange(n_sides) / n_sides
    points = np.vstack([[0.0, 0.0], np.column_stack([np.cos(angle), np.sin(angle)])])
    first = np.arange(n_sides)
    fan = np.column_stack([np.zeros(n_sides, int), 1 + first, 1 + (first + 1) % n_sides])
    mesh = SimplexMesh(points, fan)
    check = check_mesh(remesh(mesh, size), original=mesh, tolerance=2e-3)
    assert [requirement.text for requirement in check.requirements if not requirement.is_met] == []


@pytest.mark.parametrize(("target", "h"), [("triangles", 0.3), ("tetrahedra", 0.6)])
def test_the_tip_of_a_cone_without_feature_edges_stays(target, h):
    pytest.importorskip("mmgpy")
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(48)], axis=1)
    i = np.arange(48)
    sides, base = (
        np.stack([i, (i + 1) % 48, 0 * i + 48], 1),
        np.stack([(i + 1) % 48, i, 0 * i + 49], 1),
    )
    cone = SimplexMesh([*ring, [0, 0, 3], [0, 0, 0]], [*sides, *base])
    new = remesh(cone, h, target=target, backend="mmg")
    assert np.linalg.norm(new.points - [0, 0, 3], axis=1).min() < 1e-9


def test_mmg_runs_once_where_the_sizes_are_there():
    mesh, n_runs = jittered_square(6, 11), 0
    problem = replace(
        as_problem("plane triangles", mesh, 1e-3),
        size=lambda x: np.full(len(x), mesh.edge_lengths.mean()),
    )

    def run(function, text, arrays, options):
        nonlocal n_runs
        n_runs += 1
        return dict(arrays)

    adapted(problem, [1.0] * 3, run)
    assert n_runs == 1


@pytest.mark.parametrize("size", [0.2, 0.11])
def test_a_limit_of_the_memory_leaves_the_mesh_as_it_is(monkeypatch, size):
    pytest.importorskip("mmgpy")
    mesh = CartesianGrid([0.0] * 3, 0.25, (5, 5, 5)).mesh
    limited = remesh(mesh, size)
    monkeypatch.setattr(tuning, "CELLS_WITH_LIMITED_MEMORY", 0.0)
    free = remesh(mesh, size)
    np.testing.assert_array_equal(limited.points, free.points)
    np.testing.assert_array_equal(limited.cells, free.cells)


def test_the_limit_of_the_memory_grows_with_the_requested_cells():
    mesh = CartesianGrid([0.0] * 3, 0.25, (5, 5, 5)).mesh
    limits = []
    for size in (0.2, 0.05, 0.02, 0.005):
        problem = replace(
            as_problem("tetrahedra", mesh, 1e-3),
            size=lambda points, size=size: np.full(len(points), size),
        )

        def run(function, text, arrays, options):
            limits.append(options["megabytes"])
            return arrays

        adapted(problem, [0.5], run)
    few, more, *none = limits
    assert 150 < few < more
    assert more > 150 + 0.005 * 8.0 / 0.05**3  # about 8.5 tetrahedra fill the cube of an edge
    assert none == [None, None]  # more than 200 000
