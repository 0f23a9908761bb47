"""The references of limited sizes, against each other and by hand."""

import domains
import numpy as np
import pytest
from exact_oracle import plane_domain, plane_sees, plane_sizes
from geodesics import limited_sizes, sees
from numpy.testing import assert_allclose

G = 0.3
SQUARE = np.array([[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]])
BLOCK = np.array([[-5.0, -10.0], [-5.0, 10.0], [5.0, 10.0], [5.0, -10.0]])  # clockwise: a hole


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ((-20, 0), (20, 0), False),  # through the block
        ((-20, 20), (20, 20), True),  # past it
        ((-20, 10), (20, 10), True),  # along its upper side, overlapping all of it
        ((-5, 3), (-5, -50), True),  # from one of its sides along this side
        ((-5, 10), (5, -10), False),  # its diagonal, corner to corner
        ((-5, 3), (5, 3), False),  # from one side to the other inside it
        ((-5, 10), (5, 10), True),  # its upper side itself
        ((-15, 0), (5, 20), True),  # touching the corner (-5, 10) only
        ((-15, -1), (5, 19), False),  # cutting off 0.7 of that corner
        ((-15, 1e-13), (5, 20), True),  # the same touch, to rounding
        ((-5, 0), (-50, 0), True),  # from its side away
        ((-5, 0), (20, 0), False),  # from its side through it
        ((-50, -50), (50, -50), True),  # the square's own side
        ((7, 7), (7, 7), True),
    ],
)
def test_sight(a, b, expected):
    a, b = np.array([a, b], float)[:, None]
    for p, q in ((a, b), (b, a)):
        assert sees((SQUARE, BLOCK), p, q)[0] == expected


PLACES = [(-45, 45), (30, -30), (5, 5), (-40, -45), (44, 40)]


@pytest.mark.parametrize(
    "name", ["slit_square", "blocks", "maze", "spiral", "star_holes", "round_holes", "disc"]
)
def test_the_two_references_in_the_plane_agree(name):
    # One knows the polygons, the other walks through the cells: these fill the polygons.
    mesh, rings = getattr(domains, name)(2000, seed=2201)
    h0, nodes = domains.point_sources(mesh, PLACES, (1.0, 4.0, 6.0, 3.0, 2.0))
    expected = limited_sizes(rings, mesh.points, G, mesh.points[nodes], h0[nodes])
    domain = plane_domain(mesh)
    assert_allclose(plane_sizes(domain, h0, G), expected, rtol=0.0, atol=1e-12)
    pairs = np.random.default_rng(2202).integers(0, mesh.n_points, (2000, 2))
    assert np.array_equal(plane_sees(domain, pairs), sees(rings, *mesh.points[pairs.T]))
