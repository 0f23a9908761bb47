"""Fixtures of the tests of distributed meshes."""

import pytest

from adaptsize.limiting.agreement import solve_on_whole


@pytest.fixture
def nothing_is_collected(monkeypatch):
    def refuse(scheme, problem):
        if problem.domain.dim > 1:  # segments are
            raise AssertionError("the mesh was collected on one rank")
        return solve_on_whole(scheme, problem)

    monkeypatch.setattr("adaptsize.limiting.limit.solve_on_whole", refuse)
