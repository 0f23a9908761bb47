"""``remesh(strict=True)``: the requirements are met, or an error lists what was tried."""

import numpy as np
import pytest
from fake_generators import FakeBackend
from shapes import block

from adaptsize import check_mesh
from adaptsize.errors import MeshingError, ResolutionWarning
from adaptsize.remeshing import register_backend, registry, remesh

CUBE = block(2)


class Sloppy(FakeBackend):
    """Moves the mesh by three times the tolerance."""

    def solve(self, problem, run):
        self.calls.append(problem.tolerance)
        points = problem.mesh.points + np.array([3.0 * problem.tolerance, 0.0, 0.0])
        return {"points": points, "cells": problem.mesh.cells}


@pytest.fixture
def sloppy(monkeypatch):
    """Return how to remesh a cube with a generator that does not keep its tolerance."""
    monkeypatch.setattr(registry, "_BACKENDS", dict(registry._BACKENDS))
    backend = Sloppy("none")
    object.__setattr__(backend, "calls", [])
    register_backend(backend)

    def run(**arguments):
        size = np.median(CUBE.edge_lengths)
        return remesh(CUBE, arguments.pop("size", size), backend="fake", **arguments)

    run.calls = backend.calls
    return run


def test_a_smaller_tolerance_is_tried_before_giving_up(sloppy):
    # 3 * 0.4 > 1 > 3 * 0.15: the third route keeps the tolerance.
    with pytest.warns(ResolutionWarning, match=r"made by fake with 0.15 x tolerance after") as seen:
        mesh = sloppy(tolerance=1e-2, strict=True)
    assert sloppy.calls == pytest.approx([1e-2, 4e-3, 1.5e-3])
    assert check_mesh(mesh, original=CUBE, tolerance=1e-2).is_met
    message = str(seen[0].message)
    lengths = [f"{share * CUBE.diagonal:.3g}" for share in (0.03, 0.01)]
    figures = "within {} (0.03 of the diagonal), {} (0.01) allowed".format(*lengths)
    assert f"fake: boundary {figures}" in message
    assert seen[0].filename == __file__


def test_an_error_lists_what_was_tried_and_the_worst_places(sloppy):
    with pytest.raises(MeshingError, match="no mesh meets the requirements") as caught:
        sloppy(tolerance=1e-2, size=0.1, strict=True)
    message = str(caught.value)
    assert message.count("fake") == 3
    assert "edges 0.0% within a factor sqrt 2 of the size, 80% required" in message
    assert "worst places of the best: edges at (" in message
    assert [requirement.name for requirement in caught.value.check.failures] == ["edges", "served"]
