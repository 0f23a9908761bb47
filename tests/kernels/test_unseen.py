"""Cones in which a point sees nothing, against lines that are traced."""

import numba
import numpy as np
import pytest
from slots import comb, extruded, spring

from adaptsize._kernels.unseen import KEPT, Unseen, hide_behind, is_unseen
from adaptsize._workers import Workers
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.inside import Inside


@numba.njit
def unseen_boxes(walls, facets, x, middles, halves, found):
    unseen = Unseen(np.empty((KEPT, 16)), np.empty(KEPT, np.int64), np.zeros(1, np.int64))
    start = (x[0], x[1], x[2])
    for t in facets:
        hide_behind(unseen, walls, t, start)
    for i in range(len(found)):
        centre, half = middles[i], halves[i]
        box = (centre[0], centre[1], centre[2]), (half[0], half[1], half[2])
        found[i] = is_unseen(unseen, *box)


@pytest.mark.parametrize("make", [lambda: extruded(comb(4), 2.0), spring])
def test_no_point_of_an_unseen_box_is_seen(make):
    inside = Inside(Faces.of(make()))
    walls, rng = inside.walls[0], np.random.default_rng(5201)
    lower, upper = walls.boxes[1, :3], walls.boxes[1, 3:6]
    n_unseen = 0
    for x in rng.uniform(lower, upper, (40, 3)):
        n = 3000
        middles = rng.uniform(lower, upper, (n, 3))
        halves = 10.0 ** rng.uniform(-6.0, -0.5, (n, 1)) * rng.uniform(0.1, 1.0, (n, 3))
        found = np.zeros(n, np.bool_)
        facets = rng.permutation(len(walls.facets))[: 2 * KEPT]
        unseen_boxes(walls, facets, x, middles, halves, found)
        within = rng.uniform(-1.0, 1.0, (found.sum(), 8, 3))
        places = (middles[found, None] + halves[found, None] * within).reshape(-1, 3)
        starts = np.broadcast_to(x, places.shape)
        assert inside.hidden(starts, places, Workers(1)).all()
        n_unseen += len(places)
    assert n_unseen > 1000


def test_small_boxes_behind_a_facet_are_unseen_and_no_others():
    inside = Inside(Faces.of(extruded(comb(4), 2.0)))
    walls, rng = inside.walls[0], np.random.default_rng(5202)
    lower, upper = walls.boxes[1, :3], walls.boxes[1, 3:6]
    n_hidden = 0
    for t in range(len(walls.facets)):
        corner, normal = walls.facets[t, :3], walls.facets[t, 3:6]
        x = rng.uniform(lower, upper)
        places = rng.uniform(lower - 0.2, upper + 0.2, (2000, 3))
        found = np.zeros(len(places), np.bool_)
        unseen_boxes(walls, np.array([t]), x, places, np.full_like(places, 1e-9), found)
        height = (places - corner) @ normal
        below = (corner - x) @ normal
        at = x + (places - x) * (below / (height + below))[:, None] - corner
        u, v = at @ walls.facets[t, 6:9], at @ walls.facets[t, 9:12]
        margin = np.min([u, v, 1.0 - u - v, height], axis=0)
        clear = np.abs(margin) > 1e-6
        assert (found == ((below > 0.0) & (margin > 0.0)))[clear].all()
        n_hidden += found.sum()
    assert n_hidden > 1000
