"""The separation of the features of a boundary, through the domain."""

from pathlib import Path

import numpy as np
import pytest
import width_oracle
from manifold3d import Manifold
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from shapes import joined, moved
from solids import box, circle, hull, inside_out, outline, turned
from width_oracle import AllFeatures, mesh_of

from adaptsize import SimplexMesh, io
from adaptsize._progress import silent
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.separation import FeaturePoints, Separation, boundary_separation
from adaptsize.geometry.walls import WallTree
from adaptsize.geometry.width import boundary_width

DATA = Path(__file__).parents[2] / "data"
# Of exact cases: coordinates are rounded to 2e-16, and the least distances are a hundredth.
ROUNDING = 1e-12


def prism(corners, height):
    """A convex polygon, extruded."""
    flat = np.asarray(corners, float)
    return hull(
        np.concatenate([np.column_stack([flat, np.full(len(flat), z)]) for z in (0.0, height)])
    )


def at(found, *point):
    """Return the separation at a point."""
    away = np.linalg.norm(found.points - point, axis=1)
    assert away.min() < 1e-9
    return found.distances[away.argmin()]


# --- against the twin -------------------------------------------------------------


@pytest.mark.parametrize("seed", [101, 107, 139])
@pytest.mark.parametrize("part", width_oracle.SOUND_PARTS)
def test_the_trees_find_what_all_features_and_all_facets_give(part, seed):
    mesh = width_oracle.SOUND_PARTS[part](np.random.default_rng(seed))
    faces = Faces.of(mesh)
    separation, features = Separation(faces, 30.0, WallTree.of(faces)), AllFeatures(faces)
    nodes = separation.nodes
    assert_array_equal(np.unique(faces.features), np.sort(nodes.node))
    expected = [
        features.at_corner(node)
        if faces.is_corner[node]
        else features.on_curve(features.places[node], int(faces.curve[edge]))
        for node, edge in zip(nodes.node, nodes.edge, strict=True)
    ]
    # The frame is of size 1; rounding of coordinates is 1e-16.
    assert_allclose(separation.at(nodes, silent), expected, rtol=1e-12, atol=1e-15)
    if mesh.dim == 3 and len(faces.features) > 0:
        rng = np.random.default_rng(seed + 1)
        edge = rng.integers(0, len(faces.features), 60)
        ends, share = features.places[faces.features[edge]], rng.uniform(0.02, 0.98, (60, 1))
        places = share * ends[:, 0] + (1.0 - share) * ends[:, 1]
        expected = [
            features.on_curve(x, int(c)) for x, c in zip(places, faces.curve[edge], strict=True)
        ]
        found = separation.at(FeaturePoints(places, np.full(60, -1), edge), silent)
        assert_allclose(found, expected, rtol=1e-12, atol=1e-15)


# --- what no normal meets ---------------------------------------------------------


def diamond(at, radius):
    return np.asarray(at) + radius * circle(4)


def test_a_throat_between_two_corners_in_the_plane_is_its_width():
    obstacles = [diamond((x, 0.0), 1.0)[::-1] for x in (-1.025, 1.025)]
    found = boundary_separation(outline([[-4, -4], [4, -4], [4, 4], [-4, 4]], *obstacles))
    assert_allclose([at(found, x, 0.0) for x in (-0.025, 0.025)], 0.05, rtol=ROUNDING)
    # Other corners of an obstacle are as far from each other as its sides are long.
    assert_allclose(np.sort(found.distances)[2:4], np.sqrt(2.0), rtol=ROUNDING)


def crossed_bars(gap):
    """A box with two bars in it, whose edges pass each other at right angles."""
    bar = Manifold.cube([3.0, 0.5, 0.5], True).rotate([45.0, 0.0, 0.0])
    half = np.sqrt(0.125) + 0.5 * gap
    lower, upper = bar.translate([0, 0, -half]), bar.rotate([0, 0, 90]).translate([0, 0, half])
    return joined(box(5, 5, 5), *(inside_out(moved(mesh_of(b), [2.5] * 3)) for b in (lower, upper)))


@pytest.mark.parametrize("seed", [None, 3, 58])
def test_a_throat_between_two_edges_in_space_is_found_inside_the_edges(seed):
    gap = 0.05
    mesh = crossed_bars(gap)
    found = boundary_separation(mesh if seed is None else turned(mesh, seed))
    assert_allclose(found.distances.min(), gap, rtol=ROUNDING)  # both middles are points
    moved = crossed_bars(gap)
    points = moved.points.copy()
    points[-8:] += [0.37, 0.23, 0.0]
    found = boundary_separation(SimplexMesh(points, moved.cells))
    # Points on edges are at most as far apart as their separation is long.
    assert gap <= found.distances.min() < np.hypot(gap, 0.5 * gap)


def test_a_narrow_face_is_as_wide_as_it_is():
    cut = 0.02
    chamfered = prism([[cut, 0], [1, 0], [1, 1], [0, 1], [0, cut]], 3.0)
    found = boundary_separation(turned(chamfered))
    x, y, _ = (found.points @ Rotation.random(random_state=60311).as_matrix()).T
    beside = (np.abs(x) + np.abs(y - cut) < 1e-9) | (np.abs(x - cut) + np.abs(y) < 1e-9)
    assert beside.sum() > 200  # at most .028 apart along two edges of length 3
    assert_allclose(found.distances[beside], cut * np.sqrt(2.0), rtol=1e-9)


def test_the_end_of_a_slit_is_as_wide_as_the_slit():
    slit = io.read(DATA / "slit.vtu").boundary().mesh
    found = boundary_separation(slit)
    for x in (1.98, 2.02):
        assert_allclose(at(found, x, 0.8), 0.04, rtol=ROUNDING)
    # The width sees only what is narrow inside: the slit is not.
    assert boundary_width(slit).min() > 0.2


# --- corner angles ----------------------------------------------------------------


def sector(degrees, length=1.0):
    far = length * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    return [[0.0, 0.0], [length, 0.0], far]


def test_features_that_meet_at_60_degrees_do_not_separate():
    found = boundary_separation(turned(prism(sector(60.0), 3.0)))
    # At corners and middles of edges of a triangle of side 1: the corner, or side, opposite.
    assert_allclose(found.distances.min(), np.sqrt(0.75), rtol=ROUNDING)


@pytest.mark.parametrize("degrees", [10.0, 20.0, 29.0])
def test_features_that_meet_below_the_corner_angle_separate_up_to_their_corner(degrees):
    found = boundary_separation(prism(sector(degrees), 3.0))
    x, y, z = found.points.T
    side = (y == 0.0) & ((z == 0.0) | (z == 3.0)) & (x > 0.0) & (x < 0.7)
    assert side.sum() > 6
    assert_allclose(found.distances[side], x[side] * np.sin(np.radians(degrees)), rtol=1e-9)


# --- what is outside --------------------------------------------------------------


def test_a_gap_outside_the_domain_is_not_seen():
    c = [[0, 0], [3, 0], [3, 1.4], [2, 1.4], [2, 1], [1, 1], [1, 2], [2, 2], [2, 1.6], [3, 1.6],
         [3, 3], [0, 3]]  # fmt: skip
    found = boundary_separation(outline(c))
    # The prongs, 1 wide and .4 high at their ends, are .2 apart, outside.
    assert_allclose(found.distances.min(), 0.4, rtol=ROUNDING)
    solid = Manifold.cube([3.0, 3.0, 2.0]) - Manifold.cube([1.0, 1.0, 4.0]).translate([1, 1, -1])
    solid -= Manifold.cube([2.0, 0.2, 4.0]).translate([1.5, 1.4, -1])
    for mesh in (mesh_of(solid), turned(mesh_of(solid))):
        assert_allclose(boundary_separation(mesh).distances.min(), 0.4, rtol=1e-9)
    pair = joined(box(1, 1, 1), moved(box(1, 1, 1), [1.001, 0.0, 0.0]))
    assert_allclose(boundary_separation(turned(pair)).distances, 1.0, rtol=ROUNDING)
