"""What does not depend on the sizes is done once in a cycle that makes several meshes."""

import numpy as np
import pytest

from adaptsize import CartesianGrid, adapt
from adaptsize.metrics import hessian
from adaptsize.quality import connections, elements
from adaptsize.quality.by_place import RequestedElements
from adaptsize.remeshing import preparation

pytest.importorskip("mmgpy")


@pytest.fixture
def calls(monkeypatch):
    """Count the calls of functions for each number of cells of their mesh."""
    found = {}

    def count(module, name):
        function = getattr(module, name)

        def counted(mesh, *rest):
            key = name, mesh.n_cells
            found[key] = found.get(key, 0) + 1
            return function(mesh, *rest)

        monkeypatch.setattr(module, name, counted)

    count(elements, "_folded_cells")
    count(connections, "_repeated_cells")
    count(connections, "_unconnected")
    count(preparation, "_repaired")
    count(hessian, "_second_derivatives")
    return found


def grid():
    """Return triangles of the unit square of which Mmg does not make any number at once."""
    return CartesianGrid([0.0, 0.0], 0.05, (21, 21)).mesh


def test_a_mesh_is_checked_and_repaired_once(calls):
    mesh = grid()
    eta = np.exp(-5.0 * mesh.points[mesh.cells].mean(axis=1)[:, 0])
    result = adapt(mesh, eta, elements=640, enough=2.0)
    assert result.report.n_meshes > 1
    once = ("_folded_cells", "_repeated_cells", "_unconnected", "_repaired")
    assert [calls.get((name, mesh.n_cells)) for name in once] == [1, 1, 1, 1]


def test_derivatives_are_recovered_once_and_each_mesh_is_measured_once(calls, monkeypatch):
    measured, of_metric = [], RequestedElements.of_metric

    def counted(cls, mesh, *rest):
        measured.append(mesh.n_cells)
        return of_metric(mesh, *rest)

    monkeypatch.setattr(RequestedElements, "of_metric", classmethod(counted))
    mesh = grid()
    u = np.tanh((mesh.points[:, 0] - 0.5) / 0.1)
    result = adapt(mesh, elements=640, fields={"u": u}, anisotropic="u", enough=2.0)
    assert result.report.n_meshes > 1
    assert calls["_second_derivatives", mesh.n_cells] == 1
    assert len(measured) == result.report.n_meshes
