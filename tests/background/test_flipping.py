"""Edge flips in flat facets, and the edges that bound these facets."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import random_square
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from adaptsize import SimplexMesh
from adaptsize.background.flipping import flip_edges
from adaptsize.background.topology import are_among, pairs_of_cells
from adaptsize.geometry.creases import folds_of
from adaptsize.quality.elements import minimum_angles

NONE = np.empty((0, 2), np.int32)
ACROSS_KITE = [[0, 1, 2], [1, 0, 3]]


def edge_set(mesh):
    return {tuple(edge) for edge in mesh.edges.tolist()}


def stretched(n, seed, *, dim=2):
    """Triangles that were Delaunay where x was twice as long, in a tilted plane if ``dim`` is 3."""
    mesh = random_square(n, seed)
    points = mesh.points * (0.5, 1.0)
    if dim == 3:
        points = points @ Rotation.random(random_state=seed).as_matrix()[:2] + (5.0, -3.0, 9.0)
    return SimplexMesh(points, mesh.cells)


def excesses(mesh, free):
    """Sums of the angles opposite to free edges of two triangles, less 180 degrees."""
    cells, turn = np.divmod(pairs_of_cells(mesh, free & (mesh.facet_cell_counts == 2)), 3)
    total = np.full(len(cells), -np.pi)
    for side in (0, 1):
        corner, p, q = (
            mesh.points[mesh.cells[cells[:, side], (turn[:, side] + k) % 3]] for k in range(3)
        )
        u, v = p - corner, q - corner
        lengths = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
        total += np.arccos(np.clip((u * v).sum(axis=1) / lengths, -1.0, 1.0))
    return total


# --- what flips keep and what they reach ------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", [623, 624])
def test_afterwards_only_edges_that_stay_are_not_delaunay(dim, seed):
    rng = np.random.default_rng(seed)
    plain = stretched(400, seed, dim=dim)
    middles = random_square(400, seed).points[plain.cells].mean(axis=1)
    inner = plain.edges[plain.facet_cell_counts == 2]
    kept, tagged = inner[rng.permutation(len(inner))[:60]].reshape(2, 30, 2)
    mesh = replace(
        plain,
        cell_tags=(middles[:, 0] > 0.1).astype(int),
        tagged_facets=tagged[:, ::-1],
        facet_tags=np.arange(30),
        tag_names={(2, 1): "right"},
    )
    flipped = flip_edges(mesh, kept)
    assert {tuple(edge) for edge in np.concatenate([kept, tagged]).tolist()} <= edge_set(flipped)
    for tag in (0, 1):
        before, after = mesh.cell_tags == tag, flipped.cell_tags == tag
        area = mesh.measures[before].sum()
        assert flipped.measures[after].sum() == pytest.approx(area, rel=1e-12)
        rims = (SimplexMesh(m.points, m.cells[c]) for m, c in ((mesh, before), (flipped, after)))
        one, other = (rim.edges[rim.facet_cell_counts == 1] for rim in rims)
        assert_array_equal(one, other)
    assert_array_equal(flipped.tagged_facets, mesh.tagged_facets)
    assert_array_equal(flipped.facet_tags, mesh.facet_tags)
    assert dict(flipped.tag_names) == dict(mesh.tag_names)
    assert minimum_angles(flipped).min() >= minimum_angles(mesh).min()

    def free(m):
        tags = m.cell_tags[np.argsort(m.cell_facets, axis=None, kind="stable") // 3]
        start = np.cumsum(m.facet_cell_counts) - m.facet_cell_counts
        other = np.minimum(start + 1, len(tags) - 1)
        stays = np.concatenate([kept, np.sort(tagged, axis=1)])
        return (tags[start] == tags[other]) & ~are_among(m.edges, stays)

    assert excesses(mesh, free(mesh)).max() > 0.1
    assert excesses(flipped, free(flipped)).max() < 1e-6
    assert flip_edges(flipped, kept) is flipped


def test_the_middle_of_a_long_edge_with_many_nodes_on_it_is_reached():
    n = 200
    on_edge = np.column_stack([np.linspace(0.0, 1.0, n), np.zeros(n)])
    points = np.vstack([on_edge, [[0.5, 1.0], [0.5, -1.0]]])
    fan = [[i, i + 1, n] for i in range(n - 1)]
    caps = [[0, i + 1, i] for i in range(1, n - 1)]  # without any area
    mesh = SimplexMesh(points, [*fan, *caps, [0, n + 1, n - 1]])
    flipped = flip_edges(mesh, NONE)
    assert flipped.measures.min() > 0.0
    assert edge_set(flipped) >= {(i, n + 1) for i in range(n)}


# --- bent and sharp edges -----------------------------------------------------------------


@pytest.mark.parametrize(("height", "is_bent"), [(1e-8, False), (1e-4, True)])
def test_a_low_triangle_is_flat_unless_its_corner_is_far_off_the_plane(height, is_bent):
    # Seen along x, the corner of the second triangle is 20 degrees below the plane z = 0.
    slope = np.deg2rad(20.0)
    corner = height * np.array([0.0, -np.cos(slope), -np.sin(slope)]) + (0.5, 0.0, 0.0)
    mesh = SimplexMesh([[0, 0, 0], [1, 0, 0], [0.5, 0.8, 0], corner], ACROSS_KITE)
    bent, sharp = folds_of(mesh, np.deg2rad(30.0))
    assert bent.tolist() == ([[0, 1]] if is_bent else [])
    assert len(sharp) == 4
    kept = np.concatenate([bent, sharp])
    flipped = flip_edges(mesh, kept)
    assert ((2, 3) in edge_set(flipped)) == (not is_bent)
    assert_allclose(flipped.measures.sum(), mesh.measures.sum(), rtol=1e-3)
