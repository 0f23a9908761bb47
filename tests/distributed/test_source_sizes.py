"""Sizes from sources on parts of a mesh equal those on the whole, bit by bit."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube, jittered_square, random_sphere, structured_square
from partitions import KINDS, SIZE, on_ranks, partition

from adaptsize import (
    BallSource,
    BoundarySource,
    BoxSource,
    CurveSource,
    PointSource,
    RegionSource,
    SimplexMesh,
    size_from_sources,
)
from adaptsize.errors import OutsideWarning


def tagged(mesh, seed):
    """Return the mesh with two regions, and tags of some facets inside and on the boundary."""
    rng = np.random.default_rng(seed)
    facets = mesh.facets[rng.random(len(mesh.facets)) < 0.1]
    return SimplexMesh(
        np.concatenate([mesh.points, mesh.points[:1] - 100.0]),  # a node in no cell
        mesh.cells,
        cell_tags=rng.integers(1, 3, mesh.n_cells),
        tagged_facets=facets,
        facet_tags=rng.integers(4, 6, len(facets)),
    )


# In the structured square, points at nodes and curves along edges touch cells of several parts.
MESHES = {
    "structured": tagged(structured_square(6, half_width=3.0), 801),
    "jittered": tagged(jittered_square(7, 802), 803),
    "cube": tagged(jittered_cube(4, 804), 805),
    "sphere": tagged(random_sphere(60, 806), 807),
}


class OfOwnClass:
    """A source that is none of those of the package."""

    def lower_sizes(self, mesh, g, h0):
        nodes = mesh.cells[:, 0]
        h0[nodes] = np.minimum(h0[nodes], 0.3 + g * mesh.points[nodes, 0] ** 2)


def places(mesh, rng, n):
    """Return points at nodes, in the middle of edges, inside and outside."""
    used = mesh.cells[rng.integers(0, mesh.n_cells, n)]
    a, b = mesh.points[used[:, 0]], mesh.points[used[:, 1]]
    share = rng.choice([0.0, 0.5, 1.0, 0.3, 4.0], n)[:, None]
    return a + share * (b - a)


def draw(mesh, rng):
    """Return one source of each kind."""
    scale = 0.1 * mesh.diagonal
    points, curve = places(mesh, rng, 5), places(mesh, rng, 3)
    lower = places(mesh, rng, 1)[0]
    return [
        PointSource(points, rng.uniform(0.1, 1.0, 5) * scale),
        CurveSource(curve, rng.uniform(0.1, 1.0, 3) * scale),
        BoundarySource(0.2 * scale, tags=int(rng.integers(4, 6))),
        RegionSource(int(rng.integers(1, 3)), scale),
        BoxSource(lower, lower + rng.choice([0.01, 1.0]) * scale, 0.1 * scale),
        BallSource(places(mesh, rng, 1)[0], rng.choice([0.0, 1.0]) * scale, 0.1 * scale),
        lambda x: np.where(x[:, 0] > 0.0, 0.5 * scale, np.inf),
        OfOwnClass(),
    ]


def assert_equal_to_serial(mesh, sources, rank_of, g=0.25):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OutsideWarning)
        whole = size_from_sources(mesh, sources, g=g)
        results, parts = on_ranks(
            mesh, rank_of, SIZE, lambda part: size_from_sources(part, sources, g=g)
        )
    for h0, part in zip(results, parts, strict=True):
        np.testing.assert_array_equal(h0, whole[part.global_ids])
    return whole


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", MESHES)
def test_each_source_is_equal_to_serial_for_every_partition(name, kind):
    mesh, rng = MESHES[name], np.random.default_rng(808)
    sources = draw(mesh, rng)
    if name != "sphere":  # which is closed
        sources.append(BoundarySource(0.3))
    for source in sources:
        whole = assert_equal_to_serial(mesh, source, partition(mesh, kind, SIZE, rng))
    assert np.isfinite(whole).any()


@given(data=st.data())
@settings(deadline=None, max_examples=15)
def test_equal_to_serial_for_drawn_problems(data):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    mesh = MESHES[data.draw(st.sampled_from(list(MESHES)))]
    sources = [source for source in draw(mesh, rng) if data.draw(st.booleans())]
    rank_of = partition(mesh, data.draw(st.sampled_from(KINDS)), SIZE, rng)
    assert_equal_to_serial(mesh, sources, rank_of, data.draw(st.sampled_from([0.0, 0.25, 1.0])))


def test_number_of_exchanges():
    """One exchange, two more for the whole boundary; one reduction for points.

    Two for the ends of a curve, and two for each of six halvings, from 6 to .19, of its segment.
    """
    mesh = MESHES["structured"]
    cases = [
        (PointSource([0.5, 0.5], 0.1), 1, 1),
        (BallSource([0.5, 0.5], 0.1, 0.1), 1, 1),
        (CurveSource([[-3.0, 0.5], [3.0, 0.5]], 0.1), 1, 14),
        (BoundarySource(0.1), 3, None),
    ]
    for source, exchanges, reductions in cases:

        def work(part, source=source):
            counts = []
            for _ in range(2):
                traffic = part.ranks.traffic
                before = traffic.exchanges, traffic.reductions
                size_from_sources(part, source)
                counts.append((traffic.exchanges - before[0], traffic.reductions - before[1]))
            size_from_sources(part, [])
            return counts[1], traffic.reductions - before[1] - counts[1][1]

        results, _ = on_ranks(mesh, None, SIZE, work)
        for (sent, reduced), checks in results:
            assert sent == exchanges
            assert reductions is None or reduced == checks + reductions


def test_a_point_outside_is_reported_once():
    mesh = MESHES["structured"]
    with pytest.warns(OutsideWarning, match="lies 2 outside") as caught:
        on_ranks(mesh, None, SIZE, lambda part: size_from_sources(part, PointSource([5, 0.5], 0.1)))
    assert len(caught) == 1


@pytest.mark.parametrize(
    ("sources", "message"),
    [
        (
            lambda rank: PointSource([0.5, 0.5 + 0.1 * (rank == 2)], 0.1),
            r"sources\[0\] must be the",
        ),
        (lambda rank: [PointSource([0.5, 0.5], 0.1)] * (1 + (rank == 1)), "sources must be the"),
        (lambda rank: lambda x: np.full(len(x), 0.5 - rank), r"^rank 1: sources\[0\]\(points\)"),
        (lambda rank: [7], r"sources\[0\] must be a source or a function"),
        (lambda rank: RegionSource(9, 0.1), "tags must be among the cell_tags 1, 2, got 9"),
        (lambda rank: PointSource([0.5, 0.5, 0.5], 0.1), "points must"),
    ],
)
def test_bad_sources_are_refused_by_all(sources, message):
    def work(part):
        with pytest.raises(ValueError, match=message):
            size_from_sources(part, sources(part.ranks.rank))

    on_ranks(MESHES["structured"], None, SIZE, work)


def test_tags_of_other_parts_are_known():
    """A tag that only one of the parts has, and a part without any."""
    mesh = structured_square(4)
    tags = np.where(np.arange(mesh.n_cells) == 5, 3, 1)
    on_cells = SimplexMesh(mesh.points, mesh.cells, cell_tags=tags)
    rank_of = partition(mesh, "strips", SIZE, np.random.default_rng(809))
    assert_equal_to_serial(on_cells, RegionSource(3, 0.1), rank_of)
    assert_equal_to_serial(on_cells, RegionSource(3, 0.1), np.where(rank_of == 2, 0, rank_of))


def test_closed_surfaces_have_no_boundary():
    def work(part):
        with pytest.raises(ValueError, match="the mesh is closed"):
            size_from_sources(part, BoundarySource(0.1))

    on_ranks(MESHES["sphere"], None, SIZE, work)
