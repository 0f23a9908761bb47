"""What every mesh generator must do: follow the sizes, keep the domain, return clean meshes.

An adapter joins by one line in `JOBS`.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from fake_generators import FakeBackend
from shapes import block, two_region_rectangle

from adaptsize import size_conformity
from adaptsize.remeshing import register_backend, registry, remesh
from adaptsize.sizes import predict

COARSE = 0.4
CUBE = block(2)
SURFACE = CUBE.boundary().mesh
#: Kind of job: mesh, backend, package, keywords.
JOBS = {
    "volume of a surface, tetwild": (SURFACE, "tetwild", "pytetwild", {"tolerance": 2e-3}),
    "volume of a surface, netgen and mmg": (SURFACE, "mmg", "netgen", {}),
    "tetrahedra, mmg": (CUBE, "mmg", "mmgpy", {}),
    "surface, mmg": (SURFACE, "mmg", "mmgpy", {"target": "triangles"}),
    "plane, mmg": (two_region_rectangle(4), "mmg", "mmgpy", {}),
}
#: A generator that returns the given mesh keeps its domain, and has its sizes.
COPY = {"copy": (CUBE, "fake", "numpy", {})}


def quarter_in_one_half(points):
    """A quarter of the coarse size for x < 1/2, growing with gradient 0.25 beyond."""
    return np.minimum(COARSE / 4.0 + 0.25 * np.maximum(points[:, 0] - 0.5, 0.0), COARSE)


@cache
def made(job, *, graded):
    """Remesh once for all tests that look at the result."""
    mesh, backend, package, keywords = (JOBS | COPY)[job]
    pytest.importorskip(package)
    return remesh(mesh, size_of(job) if graded else COARSE, backend=backend, **keywords)


def size_of(job):
    return (lambda x: np.full(len(x), 0.55)) if job in COPY else quarter_in_one_half


@pytest.fixture(autouse=True)
def with_a_fake_generator(monkeypatch):
    support = str(Path(__file__).parents[1] / "support")
    monkeypatch.syspath_prepend(support)
    monkeypatch.setattr(registry, "_BACKENDS", dict(registry._BACKENDS))
    register_backend(FakeBackend("copy"))


def median_edge(mesh, *, x_below):
    middle = mesh.points[mesh.edges].mean(axis=1)[:, 0]
    return np.median(mesh.edge_lengths[middle < x_below])


@pytest.mark.parametrize("job", JOBS)
def test_a_quarter_of_the_size_gives_a_quarter_of_the_edge_length(job):
    # Against the same generator asked for one size everywhere: no bias of its own counts.
    # 30 %: edges of cells that fill a cube 3 cells wide cannot all be COARSE.
    coarse = median_edge(made(job, graded=False), x_below=0.5)
    fine = median_edge(made(job, graded=True), x_below=0.5)
    assert coarse / fine == pytest.approx(4.0, rel=0.3)


@pytest.mark.parametrize("job", JOBS | COPY)
def test_edges_have_the_wanted_length(job):
    conformity = size_conformity(made(job, graded=True), size_of(job))
    # Measured .88 to .95; fTetWild gives another mesh in each run.
    assert conformity.share_in_band >= 0.85, conformity
    assert conformity.served >= 0.95, conformity
    assert conformity.edges.q50 == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize("job", JOBS | COPY)
def test_the_domain_is_the_same_and_the_cells_are_sound(job):
    given, new = (JOBS | COPY)[job][0], made(job, graded=True)
    conformity = size_conformity(new, size_of(job))
    assert conformity.n_inverted == 0
    assert conformity.angle_min > 8.0
    if new.cell_dim == new.dim:
        assert (new.signed_measures > 0.0).all()
    assert np.array_equal(np.unique(new.cells), np.arange(new.n_points))
    # Each of the six sides may move by twice the tolerance, 3e-3 diagonals.
    whole = 1.0 if new.cell_dim == 3 else given.measures.sum()
    assert new.measures.sum() == pytest.approx(whole, abs=6 * 3e-3 * given.diagonal)
    outline = new.boundary().mesh if new.cell_dim > given.cell_dim else new
    if given.cell_dim == 2 and given.dim == 3:
        assert outline.is_closed
        assert given.locator.nearest(outline.points)[2].max() < 3e-3 * given.diagonal


@pytest.mark.parametrize("job", JOBS | COPY)
def test_the_estimate_of_the_number_of_cells_is_of_the_right_size(job):
    new = made(job, graded=True)
    # Measured cells fill space with edges somewhat off h: within a factor 1.7 either way.
    assert 1 / 1.7 < predict(new, size_of(job)).cells / new.n_cells < 1.7
