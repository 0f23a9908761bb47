"""Cells that overlap others, compared with the intersections of all pairs of cells."""

from itertools import combinations

import numpy as np
import pytest
from overlap_twin import common_part, measure
from scipy.spatial.transform import Rotation
from shapes import block, joined, moved

from adaptsize import SimplexMesh
from adaptsize.quality.boundary import overlapping_cells

CUBE = block(1)


def common_volume(mesh):
    """Return the volume that pairs of cells have in common, and the cells of these pairs."""
    total, cells = 0.0, set()
    low, high = (f(mesh.points[mesh.cells], axis=1) for f in (np.min, np.max))
    for a, b in combinations(range(mesh.n_cells), 2):
        if (np.maximum(low[a], low[b]) >= np.minimum(high[a], high[b])).any():
            continue
        corners = mesh.points[mesh.cells[[a, b]]]
        both = sum(measure(part) for part in common_part(*corners))
        if both > 1e-9:
            total, cells = total + both, cells | {a, b}
    return total, cells


@pytest.mark.parametrize("seed", [11, 12, 13, 14])
def test_two_bodies_have_the_common_volume_of_their_cells(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=rng).as_matrix()
    other = SimplexMesh(CUBE.points @ turn.T + rng.normal(0.0, 0.2, 3), CUBE.cells)
    mesh = joined(CUBE, other)
    volume, cells = common_volume(mesh)
    found = overlapping_cells(mesh)
    assert found.volume == pytest.approx(volume, rel=1e-6)
    # A cell in the inside of which another one is, without its centroid, may be missed.
    assert 0.5 * len(cells) <= found.n_cells <= len(cells)
    inside = [body.locator.nearest([found.place])[2][0] for body in (CUBE, other)]
    assert max(inside) < 1e-5


def test_a_body_that_overlaps_itself_is_found():
    # A ring of boxes in a row, of which the last one is pushed into the first one.
    bar = block(1, length=8)
    angle = bar.points[:, 0] / 8.0 * 2.05 * np.pi
    radius = 3.0 + bar.points[:, 1]
    points = [radius * np.cos(angle), radius * np.sin(angle), bar.points[:, 2]]
    ring = SimplexMesh(np.column_stack(points), bar.cells)
    ring = ring if ring.signed_measures[0] > 0.0 else ring.moved(ring.points * [1, 1, -1])
    found = overlapping_cells(ring)
    assert found.volume == pytest.approx(common_volume(ring)[0], rel=1e-4)
    away = ring.moved(ring.points + 0.6 * np.outer(angle, [0.0, 0.0, 1.0]))
    assert overlapping_cells(away) is None


@pytest.mark.parametrize(
    "other",
    [
        moved(CUBE, [1.0, 0.0, 0.0]),  # the same face
        moved(CUBE, [1.0, 0.3, 0.4]),  # a part of a face
        moved(CUBE, [1.0 - 5e-7, 0.3, 0.4]),  # deeper by rounding
        moved(CUBE, [1.0, 1.0, 0.0]),  # an edge
        moved(CUBE, [1.5, 0.0, 0.0]),  # nothing
    ],
)
def test_bodies_that_touch_do_not_overlap(other):
    assert overlapping_cells(joined(CUBE, other)) is None
    assert overlapping_cells(moved(joined(CUBE, other), 3.0, scale=1e-4)) is None


def test_a_body_inside_another_one_and_a_body_twice_are_found():
    for other, volume in ((moved(CUBE, 0.3, scale=0.2), 0.2**3), (CUBE, 1.0)):
        found = overlapping_cells(joined(CUBE, other))
        assert found.volume == pytest.approx(volume)
        assert f"by a volume of {volume:.3g}" in str(found)
