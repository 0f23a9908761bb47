"""Cells on which bounds are steep, and the nodes that may be sources, against plain definitions."""

import numpy as np
import pytest

from adaptsize import CartesianGrid, limit_gradient
from adaptsize._kernels.exact_candidates import drop_dominated, mark_steep
from adaptsize.limiting.exact import candidates

G, MARGIN = 0.6, 0.01


def steep_data(dim, seed):
    """Return points and cells with bounds that are steep in some of them, inf at some nodes."""
    rng = np.random.default_rng(seed)
    mesh = CartesianGrid(np.zeros(dim), 1.0, (5,) * dim).mesh
    points = mesh.points + rng.uniform(-0.2, 0.2, mesh.points.shape)
    h0 = 3.0 + points @ rng.uniform(-0.4, 0.4, dim) + rng.uniform(-0.3, 0.3, len(points))
    h0[rng.random(len(points)) < rng.choice([0.0, 0.3, 0.8])] = np.inf
    return points, mesh.cells, h0


def plain(points, cells, h0, linear):
    """Return steep cells and nodes that may be sources, before and after domination."""
    dim = points.shape[1]
    steep, marked = np.zeros(len(cells), bool), np.zeros(len(points), bool)
    for c, nodes in enumerate(cells):
        finite = np.isfinite(h0[nodes])
        if linear and finite.all():
            edges = points[nodes[1:]] - points[nodes[0]]
            gradient = np.linalg.solve(edges, h0[nodes[1:]] - h0[nodes[0]])
            if np.linalg.norm(gradient) <= G:
                continue
        marked[nodes[finite]] = True
        steep[c] = finite.sum() > 1
    kept = marked.copy()
    for nodes in cells[steep]:
        length = np.linalg.norm(points[nodes][:, None] - points[nodes][None], axis=2)
        allowed = (
            h0[nodes][:, None] + G * length + MARGIN + np.diag(np.full(dim + 1, np.inf))
        ).min(0)
        kept[nodes[allowed < h0[nodes]]] = False
    return steep, marked, kept


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("linear", [False, True])
def test_nodes_of_steep_cells_are_sources_unless_a_neighbour_dominates_them(dim, linear):
    n_gentle = n_dropped = 0
    for seed in range(2720, 2726):
        points, cells, h0 = steep_data(dim, seed)
        axes, steep = (0,) * dim, np.empty(len(cells), bool)
        candidate = np.zeros(len(points), bool)
        expected = plain(points, cells, h0, linear)
        parts = [slice(k, k + 7) for k in range(0, len(cells), 7)]
        for part in parts:  # as threads do
            mark_steep(points, axes, cells[part], h0, G, linear, steep[part], candidate)
        assert (steep == expected[0]).all()
        assert (candidate == expected[1]).all()
        for part in parts:
            drop_dominated(points, axes, cells[part], h0, G, MARGIN, steep[part], candidate)
        assert (candidate == expected[2]).all()
        n_gentle += np.count_nonzero(~steep)
        n_dropped += np.count_nonzero(expected[1] & ~expected[2])
    assert min(n_gentle, n_dropped) > 10


@pytest.mark.parametrize("dim", [2, 3])
def test_sizes_do_not_depend_on_the_chunks_in_which_cells_are_searched(dim, monkeypatch):
    mesh = CartesianGrid(np.zeros(dim), 1.0, (15 - 3 * dim,) * dim).mesh
    h0 = 3.0 + np.sin(1.7 * mesh.points @ np.arange(1.0, dim + 1.0)) + 0.2 * mesh.points[:, 0]
    listed, find = [], candidates._chosen

    def chosen(rows, n):
        listed.append(rows.copy())
        return find(rows, n)

    monkeypatch.setattr(candidates, "_chosen", chosen)
    h, info = limit_gradient.with_info(mesh, h0, 0.3)
    monkeypatch.setattr(candidates, "_CELLS", 13)
    again, in_chunks = limit_gradient.with_info(mesh, h0, 0.3)
    assert (again == h).all()
    assert (info.sources.roots() == in_chunks.sources.roots()).all()
    assert len(listed[0]) > 13, "several chunks list sources on edges"
    assert (listed[0] == listed[1]).all()
