"""Largest spheres inside boundaries with noise, holes and degenerate facets."""

import numpy as np
import pytest
from curved_shapes import irregular_torus, sliver_cylinder
from solids import box, circle, outline
from sphere_radii import EXCESS, assert_radii, sagitta, smallest

from adaptsize import SimplexMesh
from adaptsize.geometry import inscribed_spheres
from adaptsize.geometry.medial import inscribed_spheres as module

TORUS, _ = irregular_torus(30, 831)
LOW = 1.0 - 4.3 * sagitta(TORUS, 0.4) / 0.4


def test_radii_do_not_depend_on_the_number_of_probes_of_a_call(monkeypatch):
    boundary = irregular_torus(40, 619)[0]
    monkeypatch.setattr(module, "_SECONDS_PER_CALL", np.inf)  # calls of 1024, 2048, ... probes
    one = inscribed_spheres(boundary)
    monkeypatch.setattr(module, "_SECONDS_PER_CALL", 0.0)  # calls of 1024, 512, 256, ... probes
    other = inscribed_spheres(boundary)
    np.testing.assert_array_equal(other.radii, one.radii)
    np.testing.assert_array_equal(other.contacts, one.contacts)


def test_triangle_soup():
    soup = SimplexMesh(
        TORUS.points[TORUS.cells].reshape(-1, 3), np.arange(TORUS.cells.size).reshape(-1, 3)
    )
    whole = smallest(TORUS)[TORUS.cells.ravel()]
    np.testing.assert_allclose(smallest(soup), whole, rtol=EXCESS - 1.0)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_orientation_is_repaired(share):
    mesh = sliver_cylinder(32, 832)
    flipped = np.random.default_rng(833).random(mesh.n_cells) < share
    cells = np.where(flipped[:, None], mesh.cells[:, [1, 0, 2]], mesh.cells)
    np.testing.assert_allclose(smallest(SimplexMesh(mesh.points, cells)), smallest(mesh), rtol=0.02)


def test_orientation_of_outlines_is_repaired():
    ring = outline(circle(40, 2.0)[::-1], circle(40, 1.5))
    assert_radii(smallest(ring), 0.25, 0.95)


def test_small_holes_and_doubled_triangles():
    kept = np.random.default_rng(834).random(TORUS.n_cells) > 0.05
    cells = np.concatenate([TORUS.cells[kept], TORUS.cells[kept][:100]])
    radii = smallest(SimplexMesh(TORUS.points, cells))[np.unique(cells)]
    assert_radii(radii, 0.4, 0.5, 1.2)
    assert (np.abs(radii / 0.4 - 1.0) < 0.1).mean() > 0.95


def test_noise_of_a_twentieth_of_an_edge():
    move = np.random.default_rng(835).normal(size=TORUS.points.shape)
    noisy = SimplexMesh(TORUS.points + 0.05 * np.median(TORUS.edge_lengths) * move, TORUS.cells)
    ratio = smallest(noisy) / 0.4
    assert np.isinf(ratio).mean() < 1e-3  # nodes that have become tips
    ratio = ratio[np.isfinite(ratio)]
    assert np.median(ratio) > 0.9
    assert (ratio > 0.5).mean() > 0.99
    assert ratio.max() < 1.02


def test_open_sheets_have_no_inside():
    sheet = SimplexMesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    spheres = inscribed_spheres(sheet)
    assert np.isinf(spheres.radii).all()
    assert np.isnan(spheres.centres).all()
    assert np.isnan(spheres.contacts).all()


def test_degenerate_triangles_and_unused_nodes():
    solid = box(3, 2, 1)
    points = np.concatenate([solid.points, [[9, 9, 9], [1.5, 0, 0], [1.5, 0, 0]]])
    flat = [[int(np.argmin(((solid.points - [3 * k, 0, 0]) ** 2).sum(axis=1))) for k in (0, 1)]]
    cells = np.concatenate([solid.cells, [[*flat[0], 9]], [[9, 10, flat[0][0]]]])
    radii = smallest(SimplexMesh(points, cells))
    assert_radii(radii[:8], 0.5)
    assert np.isinf(radii[8])


def test_within_coarse_facets_no_sphere_stops_at_the_facets_beside():
    # A torus of 10 x 10 sides: at corners normals turn by up to 25 degrees from those of facets,
    # so that the facets beside a point stand over its tangent plane, more steeply than the
    # separation angle (20 degrees) hides.  Its nodes have radii of .84 times 0.3 and more.
    angles = 2.0 * np.pi * np.arange(10) / 10
    a, b = np.meshgrid(angles, angles, indexing="ij")
    ring = 1.0 + 0.3 * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), 0.3 * np.sin(b)], axis=-1)
    i, j = (index.ravel() for index in np.indices((10, 10)))
    corners = [10 * ((i + di) % 10) + (j + dj) % 10 for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1))]
    cells = np.concatenate(
        [np.column_stack([corners[k] for k in c]) for c in ((0, 1, 2), (0, 2, 3))]
    )
    torus = SimplexMesh(points.reshape(-1, 3), cells)
    weights = np.random.default_rng(1301).dirichlet([0.5] * 3, (len(cells), 100))
    within = np.einsum("fsv,fvd->fsd", weights, torus.points[cells]).reshape(-1, 3)
    radii = inscribed_spheres(torus, within).smallest()
    assert radii.min() > 0.75 * 0.3  # 0.62 with the facets beside
    assert radii.max() < 0.3


@pytest.mark.parametrize("merged", [True, False])
def test_radii_do_not_depend_on_the_order_of_nodes_and_facets(merged):
    rng = np.random.default_rng(836)
    move = rng.normal(size=TORUS.points.shape)
    points = TORUS.points + 0.1 * np.median(TORUS.edge_lengths) * move
    cells = TORUS.cells
    if not merged:  # a soup, in which nodes coincide
        points, cells = points[cells].reshape(-1, 3), np.arange(cells.size).reshape(-1, 3)
    to = rng.permutation(len(points))
    permuted = np.empty_like(points)
    permuted[to] = points
    other = SimplexMesh(permuted, to[cells][rng.permutation(len(cells))])
    # Many of its edges are feature edges, which have two spheres at the same point.
    one = smallest(SimplexMesh(points, cells), crease_angle=30.0)
    np.testing.assert_allclose(smallest(other, crease_angle=30.0)[to], one, rtol=1e-10)
