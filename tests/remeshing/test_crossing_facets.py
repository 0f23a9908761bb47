"""Surfaces whose facets cross, and whose union could not be made exactly."""

import warnings

import numpy as np
import pytest
from meshes import random_sphere
from shapes import CORNERS, CUBE_CELLS, joined, moved

from adaptsize import CartesianGrid, SimplexMesh
from adaptsize.errors import BackendTimeoutError, OpenSurfaceWarning
from adaptsize.geometry.solid import Solid
from adaptsize.quality.boundary import overlapping_cells
from adaptsize.remeshing.driver import remeshed
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.tetwild import mostly_inside

CUBE = SimplexMesh(CORNERS, CUBE_CELLS)
HIDDEN = SimplexMesh(0.35 + 0.1 * CORNERS, CUBE_CELLS)  # in the first cube
BODIES = joined(CUBE, moved(CUBE, [0.5, 0.2, 0.3]), HIDDEN)


@pytest.fixture
def unjoined(monkeypatch):
    """Let no union be joined, as rounding may do."""
    monkeypatch.setattr("adaptsize.geometry.solid._SAME", -1.0)


def test_tetrahedra_are_inside_with_most_of_their_points_near_the_surface():
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    several = corners + np.array([-2.0, -0.4, -0.1, 0.3])[:, None, None] * [1.0, 0.0, 0.0]

    def contains(points):
        """Whether x > 0, but for the plane in which the centroid of the third one is."""
        return (points[:, 0] > 0.0) & (np.abs(points[:, 0] - 0.15) > 1e-3)

    near = np.array([True, False, True, False])
    assert mostly_inside(several, contains, near).tolist() == [False, False, True, True]
    assert mostly_inside(several, contains, ~near).tolist() == [False, False, False, True]


@pytest.mark.usefixtures("unjoined")
def test_parts_of_a_union_that_is_not_joined_share_nodes_and_edges():
    skin, joined_area = Solid(BODIES).skin, 12.0 - 2.0 * (0.5 * 0.8 + 0.5 * 0.7 + 0.8 * 0.7)
    assert not skin.is_closed
    assert len(np.unique(skin.points, axis=0)) == skin.n_points
    assert (skin.facet_cell_counts == 2).mean() > 0.4
    assert skin.measures.sum() == pytest.approx(joined_area)


@pytest.mark.usefixtures("unjoined")
def test_fills_the_union_that_the_given_surface_encloses(monkeypatch):
    pytest.importorskip("pytetwild")
    given, call = [], IsolatedRunner.__call__

    def recorded(run, job, text, arrays, options):
        given.append((len(arrays["faces"]), options["filtered"]))
        return call(run, job, text, arrays, options)

    monkeypatch.setattr(IsolatedRunner, "__call__", recorded)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    surface = SimplexMesh(BODIES.points @ (7.0 * turn) + 20.0, BODIES.cells)
    with pytest.warns(OpenSurfaceWarning, match="overlap"):
        made = remeshed(surface, 2.0, backend="tetwild", tolerance=2e-3)
    assert given == [(24, False)]  # facets of the hidden cube are not passed, nor is it filled
    union = 2.0 - 0.5 * 0.8 * 0.7
    assert made.mesh.measures.sum() == pytest.approx(343.0 * union, rel=0.01)
    assert overlapping_cells(made.mesh) is None


def test_facets_inside_are_those_that_are_not_passed():
    hidden = Solid(BODIES).hidden
    assert hidden.tolist() == [False] * 24 + [True] * 12


def test_other_surfaces_are_filled_as_before(monkeypatch):
    given = []

    def none(run, job, text, arrays, options):
        given.append(options["filtered"])
        raise KeyboardInterrupt

    monkeypatch.setattr(IsolatedRunner, "__call__", none)
    with pytest.raises(KeyboardInterrupt):
        remeshed(random_sphere(60, 5), 0.5, backend="tetwild")
    assert given == [True]


@pytest.mark.usefixtures("unjoined")
def test_fills_without_sizes_where_they_take_too_long(monkeypatch):
    given = []
    fine = CartesianGrid([0.0] * 3, 0.5, (3, 3, 3)).mesh

    def slow(run, job, text, arrays, options):
        given.append("sizes" in arrays)
        if given == [True]:
            raise BackendTimeoutError("it took too long")
        return {"points": arrays["points"].min(axis=0) + 0.3 * fine.points, "cells": fine.cells}

    monkeypatch.setattr(IsolatedRunner, "__call__", slow)
    monkeypatch.setattr("adaptsize.remeshing.preparation.refuse_other_domain", lambda *_: None)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        made = remeshed(joined(CUBE, moved(CUBE, [0.5, 0.2, 0.3])), 0.5)
    assert given == [True, False]
    assert made.attempts.best.route == "tetwild without sizes"
    assert any("not adapted to the sizes" in str(one.message) for one in found)
