"""Each size below its bound names the bound that controls it, also along edges and around edges."""

import domains
import numpy as np
import pytest
from meshes import structured_square
from numpy.testing import assert_array_equal
from shapes import joined, moved

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting import Exact

WALL = domains.wall_box(100, seed=893)[0]
SQUARE = structured_square(3)
DOMAINS = {
    "wall": WALL,
    "window": domains.window_box(150, seed=951)[0],
    "folded": SimplexMesh(SQUARE.points, np.concatenate([SQUARE.cells, [[0, 4, 8]]])),
    "two": joined(WALL, moved(WALL, [200.0, 0.0, 0.0])),
}


@pytest.mark.parametrize("g", [0.0, 0.3])
@pytest.mark.parametrize("name", DOMAINS)
def test_named_nodes_have_bounds_that_allow_the_sizes(name, g):
    mesh = DOMAINS[name]
    rng = np.random.default_rng(952)
    for share in (0.0, 0.1, 1.0):  # of nodes with bounds
        h0 = np.where(
            rng.random(mesh.n_points) < share, rng.uniform(1.0, 50.0, mesh.n_points), np.inf
        )
        h0[0] = 1.0
        h, info = limit_gradient.with_info(mesh, h0, g, method=Exact(face_sources=False))
        reached = np.isfinite(h)
        source = info.sources.roots()
        assert_array_equal(source >= 0, reached)
        lowered = np.flatnonzero(reached & (h < h0))
        s = source[lowered]
        assert len(lowered) > 5
        assert np.isfinite(h0[s]).all()
        assert_array_equal(h[s], h0[s])
        straight = np.linalg.norm(mesh.points[lowered] - mesh.points[s], axis=1)
        assert (h0[s] + g * straight <= h[lowered] * (1.0 + 1e-9)).all()
        kept = np.flatnonzero(reached & (h == h0))
        assert_array_equal(source[kept], kept)
        if mesh.dim == 3:
            assert_bends_are_on_shortest_paths(mesh, info.sources, h, h0, g)


def assert_bends_are_on_shortest_paths(mesh, sources, h, h0, g):
    """A straight path has the length of the segment, others pass through their last bend."""
    source, bend = sources.nodes[:, 0], sources.bends
    lowered = np.isfinite(h) & (h < h0)
    straight = lowered & np.isnan(bend[:, 0])
    bent = lowered & ~straight
    first = h0[source] + g * np.linalg.norm(mesh.points - mesh.points[source], axis=1)
    assert np.allclose(h[straight], first[straight], rtol=1e-9)
    legs = np.linalg.norm(mesh.points - bend, axis=1) + np.linalg.norm(
        bend - mesh.points[source], axis=1
    )
    assert (h0[source] + g * legs <= h * (1.0 + 1e-9))[bent].all()
