"""Meshes of parts given by their surfaces, with sources inside."""

import numpy as np
import pytest
from solids import box

from adaptsize import (
    BallSource,
    BoxSource,
    CurveSource,
    PointSource,
    remesh,
    size_function,
)
from adaptsize.quality.conformity import is_in_band

pytest.importorskip("mmgpy", reason="the meshes are made by Mmg")

PLACE = np.array([1.7, 1.4, 1.6])
RADIUS = 0.25
SOURCES = {
    "point": PointSource(PLACE, 0.06),
    "curve": CurveSource([PLACE, (1.5, 1.6, 1.5)], 0.06),
    "box": BoxSource(PLACE - RADIUS, PLACE + RADIUS, 0.08),
    "ball": BallSource(PLACE, RADIUS, 0.08),
    "function": lambda x: np.where(np.linalg.norm(x - PLACE, axis=1) < RADIUS, 0.08, np.inf),
}


@pytest.mark.parametrize("name", SOURCES)
def test_cells_have_the_sizes_of_a_source_inside(name):
    part = box(3.0, 3.0, 3.0)
    size = size_function(part, sources=[SOURCES[name]], hmax=0.8, g=0.4, elements_across=0.0)
    mesh = remesh(part, size, g=0.4, hmax=0.8)
    corners = mesh.points[mesh.cells]
    middles = corners.mean(axis=1)
    pairs = corners[:, [0, 0, 0, 1, 1, 2]] - corners[:, [1, 2, 3, 2, 3, 3]]
    ratio = np.linalg.norm(pairs, axis=2).mean(axis=1) / size(middles)
    near = np.linalg.norm(middles - PLACE, axis=1) < RADIUS
    requested = (mesh.measures / size(middles) ** 3)[near]
    assert near.sum() > 50
    assert 0.7 < np.median(ratio[near]) < 1.4
    assert requested[is_in_band(ratio[near])].sum() > 0.9 * requested.sum()
    assert mesh.n_cells == pytest.approx(size.report.n_elements, rel=0.35)
    assert mesh.measures.sum() == pytest.approx(27.0, rel=1e-9)
