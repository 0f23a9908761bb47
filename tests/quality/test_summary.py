"""Summary of a mesh: names of tags, and what a surface encloses."""

import json

import numpy as np
import pytest
from shapes import CORNERS, CUBE_CELLS, joined, moved

from adaptsize import SimplexMesh, check_mesh
from adaptsize.quality.summary import summarize

NAMED = SimplexMesh(
    [[0, 0], [1, 0], [1, 1], [0, 1]],
    [[0, 1, 2], [0, 2, 3]],
    cell_tags=[1, 4],
    tagged_facets=[[0, 1], [1, 2], [2, 3]],
    facet_tags=[7, 4, 7],
    tag_names={(2, 4): "fluid", (1, 7): "hot wall", (1, 9): "nowhere"},
)


def test_names_of_tags_stand_beside_the_tags_of_their_dimension():
    summary = summarize(NAMED)
    lines = str(summary).splitlines()
    assert 'cell tags    1 (1), 4 "fluid" (1)' in lines
    assert 'facet tags   4 (1), 7 "hot wall" (2)' in lines
    found = json.loads(json.dumps(summary.as_dict()))
    assert found["cell_tag_names"] == {"4": "fluid"}
    assert found["facet_tag_names"] == {"7": "hot wall"}


def test_a_surface_encloses_the_union_of_its_bodies_and_flipped_facets_are_counted():
    cube = SimplexMesh(CORNERS, CUBE_CELLS)
    surface = joined(cube, moved(cube, 0.5))
    cells = surface.cells.copy()
    cells[[1, 2, 15], :2] = cells[[1, 2, 15], 1::-1]
    summary = summarize(SimplexMesh(surface.points, cells))
    assert summary.enclosed == pytest.approx(1.875)
    assert summary.n_flipped_facets == 3
    lines = str(summary).splitlines()
    assert "encloses     1.875" in lines
    start = "orientation  3 of 24 facets are flipped"
    assert [line.startswith(start) for line in lines].count(True) == 1
    as_is, opened = summarize(surface), summarize(SimplexMesh(CORNERS, CUBE_CELLS[1:]))
    assert (as_is.n_flipped_facets, opened.n_flipped_facets, opened.enclosed) == (0, 0, None)
    assert "orientation" not in str(as_is)
    inward = summarize(SimplexMesh(CORNERS, np.roll(CUBE_CELLS[:, ::-1], 1, axis=1)))
    assert (inward.n_flipped_facets, inward.enclosed) == (12, pytest.approx(1.0))


@pytest.mark.parametrize("place", [0.0, 1e3])
@pytest.mark.parametrize("dim", [2, 3])
def test_degenerate_cells_are_those_that_a_check_refuses(place, dim):
    """Flat up to rounding, turned and moved; thin ones are valid."""
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    flat = rng.random((dim, 3))
    inner = rng.dirichlet(np.ones(dim)) @ flat  # in the same line or plane
    normal = np.linalg.svd(flat - inner)[2][-1]
    thin = inner + 1e-6 * normal
    points = np.vstack([flat, inner, flat, thin]) @ turn + place
    mesh = SimplexMesh(points, np.arange(2 * dim + 2).reshape(2, dim + 1))
    cells = next(d for d in check_mesh(mesh).requirements if d.name == "cells")
    assert summarize(mesh).n_degenerate_cells == 1
    assert cells.text.startswith("1 of 2 inverted or flat") or dim == 3
