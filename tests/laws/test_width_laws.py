"""Laws of the width and the separation: what they may not depend on.

Separations are compared at the nodes of features and in the middles of their edges.  Points beyond
these follow from comparisons of lengths that may be equal, as on a square.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import width_oracle
from manifold3d import CrossSection, Manifold
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from width_oracle import mesh_of

from adaptsize import SimplexMesh, io
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.separation import boundary_separation
from adaptsize.geometry.width import Width, boundary_width

DATA = Path(__file__).parents[2] / "data"

# Rounding of coordinates is 1e-16 of the size, and the least values are a thousandth of it; the
# flattest facets lose some digits more. A ray that hits another wall changes by percents.
SAME = 1e-6


def quiet(*_):
    """A report of progress that goes nowhere."""


# --- parts ------------------------------------------------------------------------


def drilled_plate():
    plate = Manifold.cube([4.0, 3.0, 0.2])
    for i in range(3):
        for j in range(2):
            hole = Manifold.cylinder(2.0, 0.1 + 0.15 * i, 0.1 + 0.15 * i, 24)
            plate -= hole.translate([0.7 + 1.2 * i, 0.8 + 1.3 * j, -1.0])
    return mesh_of(plate)


def flange():
    body = Manifold.cylinder(0.3, 2.0, 2.0, 64) + Manifold.cylinder(2.0, 0.8, 0.5, 48)
    body -= Manifold.cylinder(5.0, 0.35, 0.35, 40).translate([0.0, 0.0, -1.0])
    hole = Manifold.cylinder(1.0, 0.2, 0.2, 20).translate([1.5, 0.0, -0.2])
    for k in range(6):
        body -= hole.rotate([0.0, 0.0, 60.0 * k])
    return mesh_of(body)


def fork():
    body = Manifold.cube([3.0, 1.0, 1.0])
    body -= Manifold.cube([2.0, 3.0, 0.2]).translate([1.5, -1.0, 0.4])
    hole = Manifold.cylinder(4.0, 0.2, 0.2, 32, True).rotate([90.0, 0.0, 0.0])
    body -= hole.translate([0.5, 0.5, 0.5])
    body += Manifold.cube([0.3, 0.3, 0.9]).rotate([0.0, 0.0, 45.0]).translate([0.5, 0.5, 0.8])
    return mesh_of(body)


def dovetail():
    profile = [(0, 0), (4, 0), (4, 2), (2.5, 2), (2.9, 1), (1.1, 1), (1.5, 2), (0, 2)]
    return mesh_of(Manifold.extrude(CrossSection([profile]), 1.5))


def pipes():
    pipe = Manifold.cylinder(3.0, 0.5, 0.5, 40, True)
    body = pipe + pipe.rotate([90.0, 0.0, 0.0]) - Manifold.cylinder(4.0, 0.42, 0.42, 40, True)
    return mesh_of(body)


def in_file(name):
    mesh = io.read(DATA / name)
    return mesh.boundary().mesh if mesh.cell_dim == mesh.dim else mesh


def of_random(maker, seed):
    return lambda: maker(np.random.default_rng(seed))


PARTS = {
    "plate": drilled_plate,
    "flange": flange,
    "fork": fork,
    "dovetail": dovetail,
    "pipes": pipes,
    "union": of_random(width_oracle.random_union, 77),
    "overlap": of_random(width_oracle.random_overlap, 78),
    "ball": of_random(width_oracle.noisy_ball, 79),
    "torn ball": of_random(width_oracle.torn_ball, 80),
    "polygon": of_random(width_oracle.random_polygon, 81),
    "bracket": lambda: in_file("bracket.stl"),
    "deer": lambda: in_file("deer.ply"),
    "block": lambda: in_file("block.vtu"),
    "slit": lambda: in_file("slit.vtu"),
    "curved": lambda: in_file("curved.vtu"),
    "lshape": lambda: in_file("lshape.vtu"),
}
#: Their pieces are bodies, no cavities: a cavity with flipped facets counts as a body.
BODIES = ["plate", "flange", "fork", "dovetail", "pipes", "union", "overlap", "ball", "deer",
          "bracket", "lshape"]  # fmt: skip


# --- what is compared -------------------------------------------------------------


class Found(NamedTuple):
    """Widths and separations of a part."""

    width: np.ndarray
    at_nodes: np.ndarray
    near: np.ndarray
    places: np.ndarray
    separation: np.ndarray


def found_on(mesh, queries):
    faces = Faces.of(mesh)
    width, separation = Width(faces, 30.0), boundary_separation(mesh)
    n = len(np.unique(faces.features)) + (len(faces.features) if mesh.dim == 3 else 0)
    return Found(
        boundary_width(mesh),
        width.at_nodes(quiet),
        width.near(queries, quiet),
        separation.points[:n],
        separation.distances[:n],
    )


@cache
def original(part):
    """Return a part, points around its boundary, and what is found on it."""
    mesh = PARTS[part]()
    rng = np.random.default_rng(40123)
    centre = mesh.points[mesh.cells[rng.integers(0, mesh.n_cells, 50)]].mean(axis=1)
    queries = centre + rng.normal(scale=0.02 * mesh.diagonal, size=centre.shape)
    return mesh, queries, found_on(mesh, queries)


def assert_same(found, expected, scale=1.0, rtol=SAME):
    """Compare all but places, up to rounding; inf must stay inf."""
    for name in ("width", "at_nodes", "near", "separation"):
        one, other = getattr(found, name) / scale, getattr(expected, name)
        assert_allclose(one, other, rtol=rtol, atol=0.0, err_msg=name)


def moved(part, change):
    """Return what is found on a part whose points were changed, and what on the part."""
    mesh, queries, expected = original(part)
    return found_on(SimplexMesh(change(mesh.points), mesh.cells), change(queries)), expected


# --- the laws ---------------------------------------------------------------------


def turn_of(dim, seed):
    if dim == 3:
        return Rotation.random(random_state=seed).as_matrix()
    angle = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


CHANGES = {
    "turned": lambda x, far: x @ turn_of(x.shape[1], 1861).T,
    "mirrored": lambda x, far: x * np.array([-1.0, 1.0, 1.0])[: x.shape[1]],
    "moved": lambda x, far: x + far[: x.shape[1]],
    "in another unit": lambda x, far: 3.7 * x,
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("part", PARTS)
def test_direction_place_and_unit_do_not_matter_up_to_rounding(part, change):
    # A million diagonals away coordinates are rounded to 2e-10 of the diagonal; facets and
    # widths are at least a thousandth.  In curved.vtu, a ray from the middle of an arc hits a
    # corner of two sides, of which one meets the arc: there the least rounding decides which.
    near = part in ("deer", "curved")
    far = original(part)[0].diagonal * np.array([7.0, -3.0, 5.0] if near else [1e6, -2e6, 1.5e6])
    found, expected = moved(part, lambda x: CHANGES[change](x, far))
    assert_same(found, expected, scale=3.7 if change == "in another unit" else 1.0)


@pytest.mark.parametrize("part", PARTS)
def test_powers_of_two_scale_bit_by_bit(part):
    for exponent in (41, -30):
        scale = 2.0**exponent
        found, expected = moved(part, lambda x, scale=scale: scale * x)
        for one, other in zip(found, expected, strict=True):
            assert_array_equal(one, scale * other)


class Renumbered(NamedTuple):
    """A part whose nodes and facets have other numbers, and facets start at other nodes."""

    mesh: SimplexMesh
    node: np.ndarray
    """New number of each node."""
    cells: np.ndarray
    """Old number of each cell."""


def renumbered(mesh, seed):
    rng = np.random.default_rng(seed)
    old = rng.permutation(mesh.n_points)
    node, order = np.argsort(old), rng.permutation(mesh.n_cells)
    cells = node[mesh.cells[order]]
    if mesh.dim == 3:  # segments in the plane have a direction, but no second start
        cells = np.array([np.roll(c, by) for c, by in zip(cells, rng.integers(0, 3, len(cells)),
                                                         strict=True)])  # fmt: skip
    return Renumbered(SimplexMesh(mesh.points[old], cells), node, order)


def at_places(found, places):
    """Return separations in the order of other places."""
    away, number = cKDTree(found.places).query(places)
    assert (away <= 1e-12 * np.ptp(places, axis=0).max()).all()
    assert len(np.unique(number)) == len(places) == len(found.places)
    return found.separation[number]


@pytest.mark.parametrize("part", PARTS)
def test_the_numbers_of_nodes_and_facets_do_not_matter_to_the_last_bit(part):
    mesh, queries, expected = original(part)
    other = renumbered(mesh, 77177)
    found = found_on(other.mesh, queries)
    assert_array_equal(found.width, expected.width[other.cells])
    assert_array_equal(found.at_nodes[other.node], expected.at_nodes)
    assert_array_equal(found.near, expected.near)
    assert_array_equal(at_places(found, expected.places), expected.separation)


@pytest.mark.parametrize("part", BODIES)
def test_flipped_facets_do_not_matter_to_the_last_bit(part):
    mesh, queries, expected = original(part)
    flipped = np.random.default_rng(997).random(mesh.n_cells) < 0.1
    cells = np.where(flipped[:, None], mesh.cells[:, ::-1], mesh.cells)
    found = found_on(SimplexMesh(mesh.points, cells), queries)
    for one, other in zip(found, expected, strict=True):
        assert_array_equal(one, other)
