"""`needs_remeshing`: whether, where and why."""

import numpy as np
import pytest
from meshes import jittered_cube, jittered_square, structured_square
from numpy.testing import assert_allclose
from partitions import on_ranks, partition

from adaptsize import Metric, SimplexMesh, SizeFunction, adapt, needs_remeshing, remesh
from adaptsize._checks import place_text
from adaptsize.quality.elements import folded_cells

SEED = 91133


def layer(x):
    """Small sizes at the left side."""
    return 0.05 + 0.1 * np.abs(x[:, 0] + 1.0)


@pytest.mark.parametrize("size", [0.2145, 0.4, 0.21, (0.2, 0.23)])
def test_the_decision_is_that_of_adapt(generator, size):
    mesh = structured_square(10, half_width=1.0)
    if isinstance(size, tuple):
        size = Metric(np.tile(size, (mesh.n_points, 1)), [np.eye(2)] * mesh.n_points)
    need = needs_remeshing(mesh, size)
    result = adapt(mesh, h0=size, g=None)
    assert need.needed == result.remeshed
    shares = (need.share_in_band, need.share_too_long, need.share_too_short)
    report = result.report
    assert shares == (report.share_in_band, report.share_too_long, report.share_too_short)
    assert need.predicted_cells == pytest.approx(report.predicted_elements)


def test_flat_and_inverted_cells_of_a_moved_mesh_are_found():
    mesh = structured_square(10, half_width=1.0)
    assert not needs_remeshing(mesh, 0.2145)
    points = mesh.points.copy()
    middle = int(np.argmin(np.linalg.norm(points - 0.01, axis=1)))
    points[middle] += [0.17, 0.02]
    flat = SimplexMesh(points, mesh.cells)
    need = needs_remeshing(flat, 0.2145, least_angle=12.0)
    assert "cells with angles below 12 degrees" in need.reason
    assert (flat.cells[need.cells[0]] == middle).any()
    assert "degrees" in need.places[0].reason
    assert not needs_remeshing(flat, 0.2145, least_angle=0.0)
    points[middle] += [0.1, 0.0]
    cells = np.random.default_rng(SEED).permuted(mesh.cells, axis=1)
    assert not needs_remeshing(SimplexMesh(mesh.points, cells), 0.2145)
    folded = needs_remeshing(SimplexMesh(points, cells), 0.2145, least_angle=0.0)
    assert "cells that overlap a neighbour" in folded.reason
    assert folded.places[0].reason == "a cell that overlaps a neighbour"


def test_overlaps_of_tetrahedra_are_those_of_cells_whose_sign_has_changed():
    mesh = jittered_cube(5, SEED, half_width=1.0)  # the orientation of its cells varies
    points = mesh.points.copy()
    middle = int(np.argmin(np.linalg.norm(points, axis=1)))
    points[middle] += [0.4, 0.5, 0.3]
    moved = SimplexMesh(points, mesh.cells)
    turned = np.flatnonzero(mesh.signed_measures * moved.signed_measures < 0.0)
    assert len(turned) > 2
    need = needs_remeshing(moved, mesh.edge_lengths.mean())
    worst = need.cells[: int(need.reason.split("neighbour: ")[1].split(";")[0])]
    assert np.isin(turned, worst).all()
    assert (mesh.cells[worst] == middle).any(axis=1).mean() > 0.5


@pytest.mark.parametrize("kind", ["random", "some empty"])
def test_parts_decide_like_the_whole_mesh(kind):
    mesh = jittered_cube(5, SEED, half_width=1.0)
    size = SizeFunction(mesh, layer(mesh.points))
    whole = needs_remeshing(mesh, size)
    owner = partition(mesh, kind, 3, np.random.default_rng(SEED))
    found, _ = on_ranks(
        mesh, owner, 3, lambda part: (needs_remeshing(part, layer), part.points[part.cells])
    )
    for need, _ in found:
        assert need.reason == whole.reason
        # Cells at one edge may take each other's place.
        assert [place.reason for place in need.places] == [p.reason for p in whole.places]
        assert need.places[0].severity == pytest.approx(whole.places[0].severity, rel=1e-12)
        assert need.predicted_cells == pytest.approx(whole.predicted_cells, rel=1e-12)
    assert sum(len(need.cells) for need, _ in found) == len(whole.cells)
    corners = np.concatenate([x[need.cells] for need, x in found])
    expected = mesh.points[mesh.cells[whole.cells]]
    order = [np.lexsort(x.reshape(len(x), -1).T) for x in (corners, expected)]
    assert_allclose(corners[order[0]], expected[order[1]])


def test_edges_too_long_are_worst_where_the_sizes_are_smallest():
    mesh = structured_square(10, half_width=1.0)
    need = needs_remeshing(mesh, layer)
    assert need.needed
    assert "too long" in need.places[0].reason
    assert need.places[0].point[0] < -0.8
    severity = [place.severity for place in need.places]
    assert severity == sorted(severity, reverse=True)


@pytest.mark.parametrize("seed", [3, 4])
def test_folded_triangles_are_refused_with_their_places(seed):
    mesh = jittered_square(9, seed)
    points = np.array(mesh.points)
    inner = np.argmin(np.linalg.norm(points, axis=1))
    points[inner] += [14.0, 3.0]
    folded = SimplexMesh(points, mesh.cells)
    need = needs_remeshing(folded, 8.0)
    place = next(place.point for place in need.places if "overlaps" in place.reason)
    for function in (lambda: adapt(folded, h0=8.0), lambda: remesh(folded, 8.0)):
        with pytest.raises(ValueError, match="mesh must not be folded: ") as refused:
            function()
        assert place_text(place, 4) in str(refused.value)
    turned = [np.roll(cell[::s], s) for cell, s in zip(mesh.cells, [1, -1] * 64, strict=True)]
    # Flat cells on the boundary have the sign of rounding.
    wall, c, s = mesh.facets[mesh.facet_cell_counts == 1], np.cos(0.3), np.sin(0.3)
    points = np.vstack([mesh.points, mesh.points[wall].mean(axis=1)]) @ [[c, s], [-s, c]]
    flat = np.column_stack([wall, mesh.n_points + np.arange(len(wall))])
    with_flat = SimplexMesh(points, np.vstack([turned, flat]))
    assert np.ptp(np.sign(with_flat.signed_measures[mesh.n_cells :])) > 0.0
    assert not folded_cells(with_flat).any()


def test_sizes_that_differ_between_ranks_are_refused():
    mesh = jittered_square(5, 6)

    def run(part):
        return needs_remeshing(part, np.full(part.n_points, 8.0 + part.ranks.rank))

    with pytest.raises(ValueError, match="size must be the same on all ranks that hold a node"):
        on_ranks(mesh, None, 2, run)
