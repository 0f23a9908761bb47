"""Sizes from error estimates on parts of a mesh: those of the whole."""

import numpy as np
import pytest
from meshes import jittered_cube, jittered_square
from partitions import KINDS, on_ranks, partition

from adaptsize import limit_gradient, size_from_error, size_from_hessian
from adaptsize.sizes import predicted_elements

SIZE = 4
MESHES = {"square": jittered_square(8, 891), "cube": jittered_cube(4, 892)}


@pytest.mark.parametrize("goal", [{"tolerance": 0.5}, {"elements": 500.0}])
@pytest.mark.parametrize("g", [None, 0.3])
@pytest.mark.parametrize("name", MESHES)
def test_sizes_from_error_are_those_of_the_whole(name, g, goal):
    mesh, rng = MESHES[name], np.random.default_rng(893)
    eta = rng.uniform(0.0, 1.0, mesh.n_cells) ** 4
    given = {"order": 1.0, "g": g, "hmax": 40.0, "max_coarsen": 3.0, **goal}
    whole = size_from_error(mesh, eta, **given)
    for kind in KINDS:
        rank_of = partition(mesh, kind, SIZE, rng)
        results, parts = on_ranks(
            mesh, rank_of, SIZE, lambda part: size_from_error(part, eta[part.cell_ids], **given)
        )
        for h, part in zip(results, parts, strict=True):
            np.testing.assert_allclose(h, whole[part.global_ids], rtol=1e-12)


@pytest.mark.parametrize(
    "options",
    [
        {"tolerance": 0.02},
        {"tolerance": 0.02, "norm": 2.0, "hmax": 30.0},
        {"elements": 800.0, "g": 0.3, "norm": 1.0},
    ],
)
@pytest.mark.parametrize("name", MESHES)
def test_sizes_from_second_derivatives_are_those_of_the_whole(name, options):
    mesh, rng = MESHES[name], np.random.default_rng(896)
    x = mesh.points / 50.0
    field = np.sin(3.0 * x[:, 0]) + x[:, 0] * x[:, 1] + np.where(x[:, 0] > 0.5, x[:, 1] ** 3, 0.0)
    whole = size_from_hessian(mesh, field, **options)
    for kind in KINDS if "tolerance" in options else ("random", "some empty"):
        rank_of = partition(mesh, kind, SIZE, rng)
        results, parts = on_ranks(
            mesh,
            rank_of,
            SIZE,
            lambda part: size_from_hessian(part, field[part.global_ids], **options),
        )
        for h, part in zip(results, parts, strict=True):
            np.testing.assert_allclose(h, whole[part.global_ids], rtol=1e-9)


def test_linear_fields_request_nothing():
    for mesh in MESHES.values():
        field = mesh.points @ np.arange(1.0, 1.0 + mesh.dim)
        for goal in ({"tolerance": 0.1}, {"elements": 50.0}):
            results, _ = on_ranks(
                mesh,
                None,
                SIZE,
                lambda part, f=field, goal=goal: size_from_hessian(
                    part, f[part.global_ids], **goal
                ),
            )
            assert all(np.isinf(h).all() for h in results)


def test_predicted_elements_are_those_of_the_whole():
    for mesh in MESHES.values():
        rng = np.random.default_rng(894)
        h = rng.uniform(1.0, 30.0, mesh.n_points)
        whole = predicted_elements(mesh, h, backend="mmg")
        for kind in KINDS:
            rank_of = partition(mesh, kind, SIZE, rng)
            results, _ = on_ranks(
                mesh,
                rank_of,
                SIZE,
                lambda part, h=h: predicted_elements(part, h[part.global_ids], backend="mmg"),
            )
            assert len(set(results)) == 1
            assert results[0] == pytest.approx(whole, rel=1e-13)


def test_the_search_for_a_number_of_elements_takes_few_rounds():
    mesh = MESHES["square"]
    eta = np.random.default_rng(895).uniform(0.0, 1.0, mesh.n_cells)

    def work(part):
        limit_gradient(part, 1.0, 0.3)  # finds the boundary
        before = part.ranks.traffic.exchanges
        given = {"order": 1.0, "elements": 3000.0}
        size_from_error(part, eta[part.cell_ids], **given)
        return part.ranks.traffic.exchanges - before

    results, _ = on_ranks(mesh, None, SIZE, work)
    assert 0 < results[0] <= 2 * 25


def test_bad_input_on_one_rank_is_reported_by_all():
    mesh = MESHES["square"]

    def work(part):
        eta = np.ones(part.n_cells)
        h = np.ones(part.n_points)
        if part.ranks.rank == 1:
            eta[0], h[0] = -1.0, 0.0
        with pytest.raises(ValueError, match=r"^rank 1: indicator must be finite and >= 0"):
            size_from_error(part, eta, order=1.0, tolerance=1.0)
        with pytest.raises(ValueError, match=r"^rank 1: size must be positive"):
            predicted_elements(part, h)
        eta, hmax = np.ones(part.n_cells), -1.0 if part.ranks.rank == 1 else 1.0
        with pytest.raises(ValueError, match=r"^rank 1: hmax must be finite and > 0"):
            size_from_error(part, eta, order=1.0, tolerance=1.0, hmax=hmax)

    on_ranks(mesh, None, SIZE, work)
