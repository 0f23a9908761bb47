"""Wherever the tolerance is used after the sizes, one that is 5 % larger would be noticed here."""

from types import SimpleNamespace

import numpy as np
import pytest
from meshes import random_sphere
from shapes import block

import adaptsize as ads
from adaptsize.errors import BackendError
from adaptsize.geometry.solid import Solid
from adaptsize.options import RemeshOptions, checked
from adaptsize.remeshing import improvement, job, mmg
from adaptsize.remeshing.acceptance import Judge
from adaptsize.remeshing.filling import Filling, adapt_surface
from adaptsize.remeshing.improvement import _in_rounds as in_rounds
from adaptsize.remeshing.improvement import improved
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.planning import Attempt
from adaptsize.remeshing.preparation import as_problem
from adaptsize.remeshing.tetwild import TetWildBackend

RUN = IsolatedRunner("mmg", None, None, lambda *_: None)


@pytest.mark.parametrize(("share", "is_served"), [(0.87, False), (0.92, True), (0.98, True)])
def test_what_is_beyond_nine_tenths_of_the_tolerance_is_brought_nearer_too(
    share, is_served, monkeypatch
):
    """An arc of 48 nodes; a mesh without two of them, of which one is too far away."""
    monkeypatch.setattr(improvement, "repaired", lambda mesh, *_: mesh)
    tolerance, angles = 0.02, np.arange(48) * np.pi / 24.0
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    chord = np.cos(np.pi / 24.0)
    ring[47] *= chord + 1.03 * tolerance
    ring[23] *= chord + share * tolerance
    points = [*ring, [0.0, 0.0]]
    given = ads.SimplexMesh(points, [[i, (i + 1) % 48, 48] for i in range(48)])
    kept = [i for i in range(48) if i not in (23, 47)]
    cells = [[a, b, 48] for a, b in zip(kept, np.roll(kept, -1), strict=True)]
    new = improved(ads.SimplexMesh(points, cells), given, tolerance)
    near = lambda place: np.linalg.norm(new.points[new.in_a_cell] - place, axis=1).min()  # noqa: E731
    assert near(ring[47]) < 0.15 * tolerance
    assert (near(ring[23]) < 0.15 * tolerance) == is_served


@pytest.mark.parametrize(("share", "goes_on"), [(0.98, False), (1.03, True)])
def test_rounds_go_on_while_a_place_is_beyond_the_tolerance(share, goes_on):
    flat, height = block(4), 0.05
    top = np.flatnonzero(np.abs(flat.points - [0.5, 0.5, 1.0]).max(axis=1) < 1e-9)
    (node,) = top.tolist()
    points = flat.points.copy()
    points[node, 2] += height
    risen = flat.moved(points)
    made = iter([flat, risen])
    tolerance, old = height / share, risen.boundary().mesh

    def step(now, *_):
        mesh = next(made)
        return now.with_mesh(mesh, mesh.boundary().mesh, old, 0.9 * tolerance)

    new = in_rounds(flat, old, tolerance, step)
    assert new is (risen if goes_on else flat)


def test_rounds_and_borders_have_the_given_tolerance(monkeypatch):
    asked = []
    monkeypatch.setattr(
        improvement, "_in_rounds", lambda *given, **_: asked.append(given[2]) or given[0]
    )
    monkeypatch.setattr(
        improvement, "_along_borders", lambda *given: asked.append(given[2]) or given[0]
    )
    improved(block(2), block(2), 0.01)
    assert asked == pytest.approx([0.9 * 0.01, 0.01])


def test_ftetwild_is_asked_for_the_tolerance():
    asked, skin = [], block(2).boundary().mesh

    def run(*given):
        asked.append(given[3]["epsilon"])
        return {}

    TetWildBackend().solve(as_problem("surface to tetrahedra", skin, 0.004), run)
    assert asked == pytest.approx([0.004])


def hausd_of(make, monkeypatch):
    """The largest distances that Mmg is asked for."""
    asked = []

    def once(_, mesh, sizes, hausd):
        asked.append(hausd)
        return mesh

    monkeypatch.setattr(mmg._Mmg, "adapt", once)
    make()
    return asked


def test_mmg_is_asked_for_the_tolerance_times_known_factors(monkeypatch):
    cube, tolerance = block(2), 0.003
    size = lambda x: np.full(len(x), 0.05)  # noqa: E731

    def on_surface():
        skin = cube.boundary().mesh
        adapt_surface(skin, np.empty((0, 2), np.int32), size, tolerance, RUN)

    assert set(hausd_of(on_surface, monkeypatch)) == {2.0 * tolerance, 1.6 * tolerance}
    for is_adapted in (False, True):
        problem = as_problem("tetrahedra", cube, tolerance / cube.diagonal)
        problem = problem.__class__(**{**vars(problem), "size": size, "is_adapted": is_adapted})
        asked = hausd_of(lambda: mmg.MmgBackend().solve(problem, RUN), monkeypatch)  # noqa: B023
        assert asked == pytest.approx([1.6 * tolerance] * len(asked))
        assert asked


@pytest.mark.parametrize(("factor", "is_off"), [(1.08, False), (1.12, True)])
def test_nodes_have_left_the_boundary_beyond_a_tenth_more_than_the_tolerance(factor, is_off):
    box, tolerance = block(4), 0.01
    moved = box.moved(box.points + factor * tolerance * box.diagonal * np.eye(3)[0])
    assert Judge(box, None, None, tolerance)(moved).is_off == is_off


def test_few_facets_off_a_filled_surface_are_a_fault_that_another_generator_may_cure():
    """A tip on a box that is lost by two tolerances is one; coarse facets of a sphere are not."""
    skin, tolerance = block(8).boundary().mesh, 0.01
    centres = skin.points[skin.cells].mean(axis=1)
    row = np.linalg.norm(centres - [0.5, 0.5, 1.0], axis=1).argmin()
    cell, tip = skin.cells[row], centres[row] + [0.0, 0.0, 2.0 * tolerance * skin.diagonal]
    parts = [np.where(cell == corner, skin.n_points, cell) for corner in cell]
    high = ads.SimplexMesh(
        np.vstack([skin.points, tip]), np.vstack([np.delete(skin.cells, row, axis=0), parts])
    )
    verdict = Judge(high, Solid.of(high), None, tolerance)(block(8))
    assert verdict.check.status == "missed"
    assert verdict.faults == {"boundary"}
    assert not Judge(high, None, None, tolerance)(block(8)).is_off  # nothing else would be tried
    sphere = random_sphere(4000, 7)
    hull = random_sphere(200, 7)
    cells = np.column_stack([hull.cells[:, ::-1], np.full(hull.n_cells, hull.n_points)])
    coarse = ads.SimplexMesh([*hull.points, [0.0] * 3], cells)
    assert (coarse.signed_measures > 0.0).all()
    verdict = Judge(sphere, Solid.of(sphere), None, tolerance)(coarse)
    assert verdict.check.status == "missed"
    assert not verdict.is_off


def test_remesh_fills_and_judges_with_the_given_tolerance(monkeypatch):
    pytest.importorskip("mmgpy")
    skin, asked = block(2).boundary().mesh, []

    def filled(_, problem, run):
        asked.append(problem.tolerance)
        raise BackendError("enough")

    def best_of(attempts, solve, judge, *_, **__):
        attempt = Attempt("mmg", "", 1.0, first="netgen on the adapted surface", factor=0.5)
        asked.append(judge.tolerance)
        frame = solve.__self__.requests.frame
        asked.append(0.5 * 0.004 * frame.mesh(skin).diagonal)
        next(iter(solve(attempt, RUN)))

    monkeypatch.setattr(Filling, "_in_adapted_surface", filled)
    monkeypatch.setattr(job, "best_of", best_of)
    with pytest.raises(BackendError, match="enough"):
        ads.remesh(skin, 0.5, tolerance=0.004)
    judged, allowed, given = asked
    assert judged == 0.004
    assert given == pytest.approx(allowed, rel=1e-9)


@pytest.mark.parametrize("name", ["mmg", "tetwild"])
def test_the_mesh_of_one_generator_is_improved_with_the_given_tolerance(name, monkeypatch):
    pytest.importorskip("mmgpy")
    cube, asked = block(2), []

    def as_it_is(new, given, tolerance, _):
        asked.append(tolerance / given.diagonal)
        return new

    for function in ("improved", "improved_soundly"):
        monkeypatch.setattr(job, function, as_it_is)
    monkeypatch.setattr(job, "restore", lambda *_: cube)
    mesh = cube if name == "mmg" else cube.boundary().mesh
    generator = SimpleNamespace(name=name, solve=lambda *_: {})
    request = job.prepared(mesh, 0.5, None, checked(RemeshOptions, {"tolerance": 0.004}))
    (candidate,) = request._alone(Attempt(name, "", 1.0, factor=0.5), generator, RUN)
    candidate.finish()
    assert asked == [pytest.approx(0.002, rel=1e-9)]
