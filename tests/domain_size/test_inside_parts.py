"""Sizes of a part given by its surface: they grow inside it, and sources inside act."""

import pickle
import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from slots import (
    c_ring,
    comb,
    distances_in_prism,
    extruded,
    nested_cups,
    slotted,
    spring,
    two_blocks,
)
from solids import box

from adaptsize import (
    BallSource,
    BoxSource,
    CurveSource,
    PointSource,
    SimplexMesh,
    SizeFunction,
    size_function,
)
from adaptsize.geometry.distance.winding import WindingNumber
from adaptsize.limiting import tuning

G = 0.25
PLAIN = {
    "elements_per_radian": 0.0,
    "elements_across": 0.0,
    "elements_between": 0.0,
    "tolerance": 1,
}


def inside(surface, n, seed):
    lower, upper = surface.points.min(axis=0), surface.points.max(axis=0)
    points = np.random.default_rng(seed).uniform(lower, upper, (40 * n, 3))
    return points[np.abs(WindingNumber(surface)(points)) > 0.99][:n]


def beyond_wall(points):
    return (np.hypot(points[:, 0], points[:, 1]) < 3.9) & (points[:, 2] > 1.1)


#: Surface, place of a source at a wall, its size, and the points inside that it must not affect.
SLOTS = {
    "slotted block": (lambda: extruded(slotted(), 4.0), (-0.1, 2.0, 1.0), lambda x: x[:, 0] > 0.1),
    "comb": (lambda: extruded(comb(8), 2.0), (1.0, 5.0, 1.0), lambda x: x[:, 0] > 2.3),
    "C-ring": (
        lambda: extruded(c_ring(), 1.0), (4.5 * np.cos(0.1), 4.5 * np.sin(0.1), 0.5),
        lambda x: x[:, 1] < 0.0,
    ),
    "nested cups": (nested_cups, (4.0, 0.0, 3.0), beyond_wall),
    "two blocks": (two_blocks, (4.0, 2.0, 1.0), lambda x: x[:, 0] > 4.05),
    "spring": (spring, (3.0, 0.0, 2.9), lambda x: x[:, 2] > 3.8),
}  # fmt: skip


@pytest.mark.parametrize("name", SLOTS)
def test_a_source_at_a_wall_has_no_effect_across_the_gap(name):
    make, place, is_across = SLOTS[name]
    surface, options = make(), {"hmax": 1.0, "hmin": 0.03, "g": G, "elements_per_radian": 1.0}
    options |= {"elements_across": 1.0, "elements_between": 0.0, "tolerance": 0.1}
    points = inside(surface, 600, 4101)
    across = points[is_across(points)]
    assert len(across) > 50
    without = size_function(surface, **options)
    size = size_function(surface, sources=PointSource(place, 0.03), **options)
    assert size([place])[0] == pytest.approx(0.03, rel=1e-6)
    assert_allclose(size(across), without(across), rtol=0.01)
    nearest = 0.03 + G * np.linalg.norm(across - place, axis=1)
    if name != "spring":  # whose wires are too thin for the source to show
        assert (nearest < 0.9 * without(across)).any()


@pytest.mark.parametrize("seed", range(6))
def test_sizes_are_those_along_shortest_paths_inside(seed):
    rng = np.random.default_rng(4110 + seed)
    polygon = [slotted(), comb(3, gap=0.05), c_ring(24)][seed % 3]
    part, height = extruded(polygon, 2.0), 2.0
    points = inside(part, 500, 4120 + seed)
    place = points[0] if seed < 3 else np.append(rng.permutation(np.array(polygon))[0], height)
    least, largest = 10.0 ** rng.uniform(-2.0, -0.5), 2.0
    exact = np.minimum(least + G * distances_in_prism(polygon, place)(points), largest)
    turn, scale = Rotation.random(random_state=seed).as_matrix(), 10.0 ** rng.uniform(-2, 2)

    def moved(x):
        return (x @ turn.T + [1.0, -2.0, 3.0]) * scale

    order = rng.permutation(part.n_cells)
    surface = SimplexMesh(moved(part.points), part.cells[order])
    size = size_function(
        surface, sources=PointSource(moved(place), least * scale), g=G, hmin=least * scale,
        hmax=largest * scale, **PLAIN,
    )  # fmt: skip
    found = size(moved(points)) / scale / exact
    assert np.quantile(found, 0.95) < 1.06
    assert found.max() < 1.15
    assert found.min() > 0.9  # linear sizes on facets, where they stop at hmax
    # At the nodes, no size is smaller than a shortest path allows.
    aims, nodes = size.inner.aims, size.background.points
    grown = aims.sizes + G * np.linalg.norm(nodes - aims.places, axis=1)
    own = (nodes / scale - [1.0, -2.0, 3.0]) @ turn
    at_nodes = np.minimum(least + G * distances_in_prism(polygon, place)(own), largest)
    assert (grown / scale >= at_nodes * (1.0 - 1e-4)).all()


@pytest.mark.parametrize("make", [lambda: extruded(slotted(), 4.0), lambda: extruded(comb(3), 2.0)])
def test_many_hidden_sources_do_not_keep_a_point_from_those_that_it_sees(make, monkeypatch):
    """They are behind few walls, so that few lines are traced."""
    part = make()
    lower, upper = part.points.min(axis=0), part.points.max(axis=0)
    places = np.random.default_rng(4130).uniform(lower, upper, (12, 3))
    sources = [PointSource(place, 0.03) for place in places]
    options = {"sources": sources, "hmax": 1.0, "hmin": 0.03, "g": G, **PLAIN}
    with warnings.catch_warnings():  # some are outside
        warnings.simplefilter("ignore")
        size = size_function(part, **options)
        monkeypatch.setattr(tuning, "MOST_HIDDEN", (60, 60, 1))
        assert_array_equal(size_function(part, **options).values, size.values)


PLACE = np.array([2.5, 0.0, 2.0])
INNER = {
    "point": PointSource(PLACE, 0.05),
    "curve": CurveSource([(2.0, -2.0, 2.0), PLACE, (3.0, 2.0, 1.0)], 0.05),
    "box": BoxSource(PLACE - 0.3, PLACE + 0.3, 0.05),
    "ball": BallSource(PLACE, 0.3, 0.05),
    "function": lambda x: np.where(np.linalg.norm(x - PLACE, axis=1) < 0.3, 0.05, np.inf),
}


@pytest.mark.parametrize("name", INNER)
def test_sources_inside_act_where_they_are_and_on_walls_that_they_see(name, recwarn):
    part = extruded(slotted(), 4.0)
    size = size_function(part, sources=[INNER[name]], hmax=1.0, g=G, **PLAIN)
    assert not recwarn.list
    plain = size_function(part, hmax=1.0, g=G, **PLAIN)
    assert size([PLACE])[0] == pytest.approx(0.05)
    assert size([[2.5, 0.0, 3.3]])[0] <= 0.05 + G * 1.31
    (wall,) = size([[0.1, 0.0, 2.0]])
    assert wall <= 0.05 + G * 2.45  # 2.4 away, or less
    assert wall >= 0.05 + G * 1.8
    assert size([[-0.1, 0.0, 2.0], [-3.0, 0.0, 2.0]]) == pytest.approx(1.0)  # across the slot
    assert size.report.n_elements > plain.report.n_elements + 1000.0
    assert "sources" in size.report.causes
    assert size.clip(hmin=0.2)([PLACE])[0] == pytest.approx(0.2)
    if name != "function":
        again = pickle.loads(pickle.dumps(size))
        assert_allclose(again([PLACE]), size([PLACE]))


def test_the_prediction_counts_a_source_inside_like_one_in_tetrahedra():
    part = box(4.0, 4.0, 4.0)
    size = size_function(part, sources=PointSource([2.1, 1.9, 2.2], 0.02), hmax=1.0, g=G, **PLAIN)
    r = np.linspace(0.0, 1.8, 4000)
    h = 0.02 + G * r
    # The ball of radius 1.8 around the source alone, in regular tetrahedra.
    within = 6.0 * np.sqrt(2.0) * np.trapezoid(4.0 * np.pi * r**2 / h**3, r)
    assert within < size.report.n_elements < 2.5 * within


def test_a_source_outside_acts_on_the_closest_point_of_the_surface():
    part = box(4.0, 4.0, 4.0)
    with pytest.warns(match=r"PointSource requests the size 0\.1 at .* 0\.5 outside of the part"):
        size = size_function(part, sources=PointSource([2.0, 2.0, 4.5], 0.1), hmax=1.0, **PLAIN)
    assert size([[2.0, 2.0, 4.0]])[0] == pytest.approx(0.1 + G * 0.5, rel=0.01)


def test_nodal_sizes_of_any_surface_grow_inside_it():
    part = extruded(slotted(), 4.0)
    values = np.where(np.isclose(part.points[:, 0], -0.1), 0.1, 2.0)
    size = SizeFunction(part, values, g=G)
    assert size([[-0.2, 4.0, 2.0]])[0] == pytest.approx(0.1 + G * 0.1)
    # The node of size 0.1 at the other wall is 0.3 away, and around the slot 16.
    assert size([[0.2, 4.0, 2.0]])[0] > 1.5
