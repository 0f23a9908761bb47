"""Filling a closed surface: preparation of the surface, and Netgen."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from fake_generators import Recording, RecordingRunner, registered
from numpy.testing import assert_allclose, assert_array_equal
from shapes import CORNERS as CUBE
from shapes import CUBE_CELLS, block, joined
from solids import cylinder

from adaptsize import SimplexMesh, remesh, size_conformity
from adaptsize.errors import (
    BackendError,
    BackendTimeoutError,
    OpenSurfaceWarning,
    ResolutionWarning,
)
from adaptsize.geometry.enclosed import is_oriented
from adaptsize.geometry.solid import Solid
from adaptsize.options import RemeshOptions, checked
from adaptsize.remeshing import filling, netgen
from adaptsize.remeshing.acceptance import Judge
from adaptsize.remeshing.crossings import crossing_facets, smaller_at
from adaptsize.remeshing.filling import adapt_surface, unless_overlapping
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.job import prepared
from adaptsize.remeshing.mmg import MmgBackend
from adaptsize.remeshing.planning import plan
from adaptsize.remeshing.preparation import as_problem
from adaptsize.remeshing.surface import refine_surface
from adaptsize.sizes.prediction import Prediction

pytest.importorskip("mmgpy", reason="the meshes are made by Mmg")
pytest.importorskip("netgen", reason="the surfaces are filled by Netgen")


def cube(shift=0.0):
    return SimplexMesh(CUBE + shift, CUBE_CELLS)


def enclosed(mesh):
    return float(np.linalg.det(mesh.points[mesh.cells]).sum()) / 6.0


def distance(one, other):
    return size_conformity(one, 1.0, surface=other).hausdorff


@pytest.fixture
def run():
    return IsolatedRunner("netgen", None, None, lambda *_: None)


def test_netgen_keeps_the_surface_exactly(run):
    surface = cylinder(24, 0.2)
    raw = netgen.fill(surface, run)
    volume = SimplexMesh(raw["points"], raw["cells"])
    assert_array_equal(raw["points"][: surface.n_points], surface.points)
    boundary = volume.facets[volume.facet_cell_counts == 1]
    assert set(map(tuple, boundary)) == set(map(tuple, np.sort(surface.cells, axis=1)))
    assert (volume.signed_measures > 0.0).all()
    assert_allclose(volume.measures.sum(), enclosed(surface), rtol=1e-12)


def test_netgen_fills_a_shell_and_two_bodies(run):
    outer = SimplexMesh(3.0 * CUBE - 1.0, CUBE_CELLS)
    cavity = SimplexMesh(CUBE, CUBE_CELLS[:, ::-1])
    assert netgen.fill(joined(outer, cavity), run) is not None
    assert netgen.fill(joined(cube(), cube([2.0, 0.0, 0.0])), run) is not None


def test_bodies_inside_out_are_filled_by_netgen():
    other = cube([2.0, 0.0, 0.0])
    both = joined(cube(), SimplexMesh(other.points, other.cells[:, ::-1]))
    _, found = attempts_at(both, 0.5, RecordingRunner.without())
    assert_allclose(found.best.mesh.measures.sum(), 2.0, rtol=1e-9)
    (only,) = found.tried
    assert (only.route, only.status) == ("netgen on the adapted surface, then mmg", "met")


def test_surfaces_that_netgen_must_not_fill_are_refused_before_it_starts():
    def start(*_):
        pytest.fail("Netgen was started")

    run = IsolatedRunner("netgen", None, None, start)
    turned = CUBE_CELLS.copy()
    turned[0] = turned[0, ::-1]
    for surface in (SimplexMesh(CUBE, CUBE_CELLS[1:]), SimplexMesh(CUBE, turned)):
        with pytest.raises(BackendError, match="not closed or not oriented"):
            netgen.fill(surface, run)
    for scale in (1e-3, 1.0, 30.0):
        crossed = joined(cube(), cube([0.5, 0.3, 0.4]))
        with pytest.raises(BackendError, match=r"crosses itself at \("):
            netgen.fill(crossed.moved(scale * crossed.points), run)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit of processor time")
def test_processor_time_is_limited(run):
    surface, _ = refine_surface(cylinder(200, 0.2), lambda x: np.full(len(x), 0.008), 1e-5)
    with pytest.raises(BackendTimeoutError, match="limit of processor time"):
        netgen.fill(surface, replace(run, seconds=0.5))


def test_the_processor_time_for_a_surface_grows_with_its_triangles():
    limits = []
    for seconds in (np.inf, 5.001):
        for surface in (cube(), cylinder(24, 0.2)):
            run = replace(RecordingRunner.without("netgen:tetrahedralize"), seconds=seconds)
            with pytest.raises(BackendError, match="netgen failed"):
                netgen.fill(surface, run)
            limits += [limit for _, _, limit in run.jobs]
    n = cylinder(24, 0.2).n_cells
    assert_allclose(limits, [5.012, 5.0 + 1e-3 * n, 5.001, 5.001])


def test_a_result_that_is_not_the_surface_is_refused():
    surface = cube()
    made = {"points": CUBE, "cells": np.array([[0, 1, 3, 7]])}
    assert not netgen._fills(made, surface)
    # Five tetrahedra fill the cube, but some of their facets cross its diagonals.
    five = np.array([[0, 3, 5, 6], [1, 0, 3, 5], [2, 3, 0, 6], [4, 5, 6, 0], [7, 6, 5, 3]])
    v = np.linalg.det(CUBE[five][:, 1:] - CUBE[five][:, :1])
    five[v < 0.0, :2] = five[v < 0.0, 1::-1]
    assert_allclose(SimplexMesh(CUBE, five).signed_measures.sum(), 1.0)
    assert not netgen._fills({"points": CUBE, "cells": five}, surface)


def test_refined_surface_is_the_same_surface():
    surface = cylinder(12, 0.2)
    refined, _ = refine_surface(surface, lambda x: np.full(len(x), 0.02), 1e-3)
    assert is_oriented(refined)
    assert refined.edge_lengths.max() <= 4.0 * 0.02
    assert distance(refined, surface) <= 3e-4
    assert_allclose(enclosed(refined), enclosed(surface), rtol=1e-3)


@pytest.mark.parametrize(
    ("n", "kept"),
    [
        (16, True),  # rounding would bulge by .2 * .39^2 / 8 = 4e-3
        (160, False),  # ... by 4e-5
    ],
)
def test_coarse_facets_stay_facets_and_fine_ones_are_rounded(n, kept):
    refined, ridges = refine_surface(cylinder(n, 0.2), lambda x: np.full(len(x), 0.1), 1e-3)
    ends = refined.points[ridges]
    on_rim = (ends[:, 0, 2] == ends[:, 1, 2]) & np.isin(ends[:, 0, 2], (0.0, 1.0))
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert_allclose(lengths[on_rim].sum(), 2 * n * 0.4 * np.sin(np.pi / n))
    assert_allclose(lengths[~on_rim].sum(), n if kept else 0.0)


def strip(width):
    """A cube with a strip of that width along one edge, as CAD exports leave them."""
    n = 8
    points = np.concatenate([CUBE, [[width, 0.0, 0.0], [width, 0.0, 1.0]]])
    beside = [0, 4, 5], [0, 5, 1], [0, 6, 4], [1, 5, 7]
    cells = [c for c in CUBE_CELLS.tolist() if c not in beside]
    cells += [[0, n, n + 1], [0, n + 1, 1], [n, 4, 5], [n, 5, n + 1]]
    cells += [[0, 6, n], [n, 6, 4], [1, n + 1, 7], [n + 1, 5, 7]]
    return SimplexMesh(points, cells)


@pytest.mark.parametrize("width", [0.3, 1e-5])
def test_tagged_edges_are_ridges_whether_slivers_are_removed_or_not(width):
    part = strip(width)
    tagged = SimplexMesh(
        part.points, part.cells, tagged_facets=[[7, 2], [0, 3]], facet_tags=[1, 0]
    )  # diagonals of flat sides
    plain, tagged = (
        refine_surface(m, lambda x: np.full(len(x), 2.0), 1e-3) for m in (part, tagged)
    )
    before, after = (
        {tuple(sorted(map(tuple, ends))) for ends in m.points[ridges].round(9).tolist()}
        for m, ridges in (plain, tagged)
    )
    assert len(plain[0].points) == (10 if width > 0.1 else 8)
    assert after - before == {tuple(sorted(map(tuple, CUBE[[2, 7]].tolist())))}


def test_the_adapted_surface_has_the_sizes_and_keeps_tags_and_ridges(run):
    surface = cylinder(24, 0.5)
    top = (surface.points[surface.cells, 2] == 1.0).all(axis=1)
    surface = SimplexMesh(surface.points, surface.cells, cell_tags=np.where(top, 7, 3))

    def size(x):
        return 0.04 + 0.1 * x[:, 2]

    tolerance = 1e-3 * surface.diagonal
    refined, ridges = refine_surface(surface, size, tolerance)
    new, kept = adapt_surface(refined, ridges, size, tolerance, run)
    assert is_oriented(new)
    assert size_conformity(new, size).share_in_band > 0.8
    assert distance(new, surface) <= tolerance
    on_top = new.points[new.cells[new.cell_tags == 7]]
    assert_allclose(on_top[:, :, 2], 1.0)
    assert_allclose(new.measures[new.cell_tags == 7].sum(), surface.measures[top].sum(), rtol=1e-3)
    rims = np.linalg.norm(new.points[kept[:, 0]] - new.points[kept[:, 1]], axis=1).sum()
    before = refined.points[ridges]
    assert_allclose(rims, np.linalg.norm(before[:, 0] - before[:, 1], axis=1).sum(), rtol=1e-2)


def attempts_at(surface, size, run, **options):
    """Return the job of `remesh` with its attempts in a run."""
    job = prepared(surface, size, None, checked(RemeshOptions, options))
    return job, job.attempts(run)


def test_mmg_starts_from_a_surface_of_the_sizes_and_from_the_given_one_if_that_fails():
    surface, meshes, is_adapted = cylinder(16, 0.2), [], []
    for failing in ((), ("surface",)):  # the surface is not adapted then
        run, mmg = RecordingRunner.without(*failing), Recording("mmg")
        with registered(mmg):
            _, found = attempts_at(surface, 0.1, run)
        (filled,) = run.arrays("netgen:tetrahedralize")
        meshes.append(SimplexMesh(filled["points"], filled["faces"]))
        is_adapted.append([problem.is_adapted for problem in mmg.problems])
    size = 0.1 / surface.diagonal  # generators work on a part of diagonal 1
    assert np.median(meshes[0].edge_lengths) == pytest.approx(size, rel=0.3)
    assert meshes[1].edge_lengths.max() > 1.5 * size
    assert is_adapted == [[True], [False]]
    assert_allclose(found.best.mesh.measures.sum(), enclosed(surface), rtol=0.01)


@pytest.mark.parametrize("is_followed", [False, True])
def test_rounds_have_the_tolerance_and_may_give_up_if_another_attempt_follows(
    is_followed, monkeypatch
):
    asked = []

    def as_it_is(mesh, surface, tolerance, _, *, give_up):
        asked.append((give_up is not None, tolerance / surface.diagonal))
        if give_up is not None and len(asked) == 2:
            give_up()
        return mesh

    monkeypatch.setattr(filling, "improved", as_it_is)
    job = prepared(cylinder(12, 0.3), 0.3, None, checked(RemeshOptions, {"tolerance": 4e-3}))
    attempt = replace(plan(job.known())[0], is_followed=is_followed, factor=0.5)
    meshes = [
        (candidate.finish(), candidate.complete)
        for candidate in job.solve(attempt, RecordingRunner.without())
    ]
    expected = (is_followed, pytest.approx(2e-3, rel=1e-9))
    assert asked == [expected, expected]  # the filled mesh, and the adapted one
    if not is_followed:
        assert [complete() for _, complete in meshes] == [None, None]
        return
    assert meshes[0][1]() is None  # not given up
    new = meshes[1][1]()
    assert asked[2:] == [(False, expected[1])]
    assert_array_equal(new.points, meshes[1][0].points)


@pytest.mark.parametrize("backend", ["mmg", "tetwild"])
def test_a_mesh_of_too_many_cells_is_improved_later(backend, monkeypatch):
    asked = []

    def as_it_is(mesh, surface, tolerance, size, **_):
        asked.append(mesh.n_cells)
        return mesh

    monkeypatch.setattr(filling, "improved", as_it_is)
    options = checked(RemeshOptions, {"tolerance": 4e-3, "backend": backend})
    job = prepared(cylinder(12, 0.3), 0.3, None, options)
    for most in (1.0, 1e9):
        *_, last = replace(job, most=most).solve(plan(job.known())[0], RecordingRunner.without())
        mesh = last.finish()
        before = len(asked)
        whole = last.complete()
        if most == 1.0:
            assert (before, asked) == (0, [mesh.n_cells])
            assert_array_equal(whole.cells, mesh.cells)
        else:
            assert whole is None
            assert before == 2


def test_a_mesh_that_would_take_too_long_is_given_up():
    pytest.importorskip("resource", reason="the system has no limit of processor time")
    square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    problem = replace(
        as_problem("plane triangles", square, 1e-3), size=lambda x: np.full(len(x), 0.002)
    )
    run = IsolatedRunner("mmg", None, None, lambda *_: None, seconds=1e-3)
    with pytest.raises(BackendTimeoutError, match=r"limit of processor time .* too large for the"):
        MmgBackend().solve(problem, run)


def test_a_failure_of_mmg_leaves_the_cells_that_fill_the_surface():
    text = "the tetrahedra are those that fill the surface, not adapted .*: mmg failed"
    with (
        registered(Recording("mmg", fails=True)),
        pytest.warns(ResolutionWarning, match=text) as seen,
    ):
        new = remesh(cube(), 0.3, tolerance=1e-2)
    assert seen[0].filename == __file__
    assert_allclose(new.measures.sum(), 1.0)


def test_a_failure_of_mmg_and_netgen_leaves_ftetwild():
    mmg, run = Recording("mmg", fails=True), RecordingRunner.without("netgen:tetrahedralize")
    with registered(mmg):
        _, found = attempts_at(cube(), 0.3, run, tolerance=1e-2)
    assert_allclose(found.best.mesh.measures.sum(), 1.0, rtol=1e-2)
    assert [(one.route, one.status) for one in found.tried] == [
        ("netgen on the adapted surface, then mmg", "failed"),
        ("netgen, then mmg", "failed"),
        ("tetwild", "met"),
    ]
    with registered(mmg, Recording("tetwild", fails=True)):
        _, found = attempts_at(cube(), 0.3, run, tolerance=5e-3)
    assert found.best is None
    assert found.failures().startswith(
        "netgen on the adapted surface, then mmg, netgen, then mmg: "
    )


@pytest.mark.parametrize(
    ("tagged", "route", "reason"),
    [
        # The boundary of the union is a surface that Netgen can fill.
        (
            False,
            "netgen on the adapted surface, then mmg",
            "the surface is closed and does not cross itself",
        ),
        # Tagged edges are edges of the given facets.
        (True, "tetwild", "facets of the surface cross others: fTetWild makes the union"),
    ],
)
def test_bodies_that_cross_become_their_union(tagged, route, reason):
    crossed = joined(cube(), cube([0.5, 0.3, 0.4]))
    if tagged:
        crossed = replace(crossed, tagged_facets=[[0, 1]], facet_tags=[1])
    with pytest.warns(OpenSurfaceWarning, match="bodies 1 and 2 overlap"):
        _, found = attempts_at(crossed, 0.3, RecordingRunner.without(), tolerance=1e-2)
    (only,) = found.tried
    assert (only.route, only.reason) == (route, reason)
    assert_allclose(found.best.mesh.measures.sum(), 2.0 - 0.5 * 0.7 * 0.6, rtol=0.03)


def test_another_number_of_cells_in_an_open_surface_is_reported():
    opened, run = SimplexMesh(CUBE, CUBE_CELLS[2:]), RecordingRunner.without()
    with pytest.warns(OpenSurfaceWarning, match="the surface is open"):
        job = prepared(opened, 0.15, None, checked(RemeshOptions, {"tolerance": 1e-2}))
    found = replace(job, predicted=Prediction(100.0)).attempts(run)
    assert re.match(r"\d+ elements instead of the predicted 100: the mesh", found.best.note)
    assert [one.route for one in found.tried] == ["tetwild"]
    assert {name for name, _, _ in run.jobs} == {"tetwild:tetrahedralize"}


def test_a_surface_whose_sharp_edges_are_closer_than_the_sizes_is_left_to_another_generator():
    """Mmg would keep them all, and Netgen take minutes for a large one."""
    rough = block(12).boundary().mesh
    rng = np.random.default_rng(7211)
    rough = rough.moved(rough.points + rng.normal(0.0, 0.012, rough.points.shape))
    run = RecordingRunner.without()
    _, found = attempts_at(rough, 0.3, run, tolerance=2e-2)
    first, second, last = found.tried
    wanted = r"mmg made \d{4} triangles of the surface instead of \d{3}, since it keeps sharp edges"
    assert re.match(wanted, first.text)
    assert (second.route, second.text) == ("netgen, then mmg", first.text)
    assert (last.route, last.status) == ("tetwild", "met")
    assert not run.arrays("netgen:tetrahedralize")


def test_facets_that_were_predicted_badly_are_made_where_there_are_few_sharp_edges(run):
    """A function of the place is predicted from a sample, which may miss a source."""
    surface = block(2).boundary().mesh
    job = prepared(surface, 0.1, None, checked(RemeshOptions, {}))
    found = replace(job, predicted=job.predicted._replace(facets=100.0)).attempts(run)
    assert [one.route for one in found.tried] == ["netgen on the adapted surface, then mmg"]


def test_flat_cells_and_boundaries_that_are_off_are_left_to_another_generator():
    whole = block(4)
    # Two cubes of an edge of the block are left out, which have one edge in common.
    cube_of = np.floor(whole.points[whole.cells].mean(axis=1) * 4.0).astype(int)
    out = (cube_of == [0, 0, 0]).all(axis=1) | (cube_of == [1, 1, 0]).all(axis=1)
    pinched = SimplexMesh(whole.points, whole.cells[~out])
    points = whole.points.copy()
    inside = ((points > 0.1) & (points < 0.9)).all(axis=1).nonzero()[0][0]
    neighbours = np.unique(whole.cells[(whole.cells == inside).any(axis=1)])
    points[inside] += 0.99 * (points[neighbours[0]] - points[inside])
    flat = whole.moved(points)
    judge = Judge(cube(), Solid(cube()), None, 2e-2)
    found = {name: judge(mesh) for name, mesh in
             (("whole", whole), ("pinched", pinched), ("flat", flat),
              ("off", whole.moved(0.9 * whole.points + 0.05)))}  # fmt: skip
    assert {name: verdict.faults for name, verdict in found.items()} == {
        "whole": set(), "flat": {"angles"}, "off": {"boundary"},
        "pinched": {"boundary", "topology"},
    }  # fmt: skip
    assert sorted(found, key=lambda name: found[name].rank) == ["whole", "flat", "off", "pinched"]


def test_an_improvement_that_makes_cells_overlap_is_not_kept():
    whole = block(2)
    twice, smaller = (
        joined(whole, whole.moved(whole.points + 0.1)),
        whole.moved(0.99 * whole.points),
    )
    assert unless_overlapping(twice, whole) is whole
    assert unless_overlapping(smaller, whole) is smaller
    assert unless_overlapping(twice, twice) is twice


def _rotated(n, rows, height):
    """A closed surface around an axis from its outline: radius and height of each row."""
    turn = 2.0 * np.pi * np.arange(n) / n
    circle = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(n)])
    points = np.concatenate([r * circle + [0.0, 0.0, height * z] for r, z in rows])
    here, cells = np.arange(n), []
    for k in range(len(rows)):
        a, b = here + n * k, (here + 1) % n + n * k
        c, d = (x + n * ((k + 1) % len(rows) - k) for x in (a, b))
        cells += [np.column_stack([a, b, d]), np.column_stack([a, d, c])]
    return SimplexMesh(points, np.concatenate(cells))


def shaft_in_bore(gap):
    """Two tubes with a gap between them."""
    inner = _rotated(128, [(1.0, 0), (1.0, 1), (0.6, 1), (0.6, 0)], 0.1)
    outer = [(1.5, 0), (1.5, 1), (1.0 + gap, 1), (1.0 + gap, 0)]
    return joined(inner, _rotated(128, outer, 0.1))


def test_an_adapted_surface_that_crosses_itself_is_made_again_with_smaller_sizes_there():
    surface, size = shaft_in_bore(0.0015), 0.15
    run = RecordingRunner.without()
    with pytest.warns(OpenSurfaceWarning, match="apart"):
        _, found = attempts_at(surface, size, run)
    assert [(one.route, one.status) for one in found.tried] == [
        ("netgen on the adapted surface, then mmg", "met")
    ]
    assert len(run.arrays("surface")) > 2  # two for each surface
    (filled,) = run.arrays("netgen:tetrahedralize")
    assert not len(crossing_facets(SimplexMesh(filled["points"], filled["faces"])).cells)
    lengths = found.best.mesh.edge_lengths
    assert np.median(lengths) == pytest.approx(size, rel=0.4)


def test_sizes_at_crossings_are_halved_and_grow_off_them():
    places = np.array([[0.0, 0.0, 0.0], [99.0, 0.0, 0.0]])
    size = smaller_at(lambda x: 1.0 + x[:, 0], places)
    points = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 9.0, 0.0], [99.0, 0.0, 0.0]])
    assert_allclose(size(points), [0.5, 0.75, 1.0, 0.5 + 0.25 * 99.0])


def test_facets_that_an_adapted_surface_crosses_by_very_little_count(monkeypatch):
    """Netgen fails on them; in files, they are within the rounding of nine digits."""
    depth = 3e-7
    crossed = joined(cube(), cube([0.5, 0.3, 1.0 - depth]))
    assert not len(crossing_facets(crossed).cells)
    none = np.empty((0, 2), np.int32)
    same = np.arange(crossed.n_points)
    monkeypatch.setattr(filling, "remove_slivers", lambda *_: (crossed, same))
    problem = as_problem("surface to tetrahedra", crossed, 1e-3)
    problem = replace(problem, size=lambda x: np.full(len(x), 0.5))
    places = filling._without_slivers(crossed, none, problem)[2]
    assert len(places)
    assert_allclose(places[:, 2], 1.0, atol=2.0 * depth)


def test_slivers_stay_where_facets_cross_without_them(monkeypatch):
    """One cube is moved into another one instead of the removal of its slivers."""
    crossed = joined(cube(), cube([0.5, 0.3, 0.4]))
    same = np.arange(crossed.n_points)
    monkeypatch.setattr(filling, "remove_slivers", lambda *_: (crossed, same))
    apart = joined(cube(), cube([2.0, 0.0, 0.0]))
    problem = as_problem("surface to tetrahedra", apart, 1e-3)
    problem = replace(problem, size=lambda x: np.full(len(x), 0.5))
    none = np.empty((0, 2), np.int32)
    surface, _, places = filling._without_slivers(apart, none, problem)
    assert surface is apart
    assert len(places) == 0


def test_netgen_is_not_run_again_after_its_limit_of_time(monkeypatch):
    asked = []

    def fill(surface, _run):
        asked.append(surface.n_cells)
        raise BackendTimeoutError("too long")

    monkeypatch.setattr(netgen, "fill", fill)
    _, found = attempts_at(cube(), 0.5, RecordingRunner.without("tetwild:tetrahedralize"))
    assert [one.status for one in found.tried[:2]] == ["timeout", "timeout"]
    assert len(asked) == 2
