"""Fixtures of the tests of distributed meshes."""

import pytest

from adaptsize.limiting.in_parts import limit as api


@pytest.fixture
def nothing_is_collected(monkeypatch):
    collected = api._collected

    def refuse(part, *args):
        if part.dim > 1:  # segments are
            raise AssertionError("the mesh was collected on one rank")
        return collected(part, *args)

    monkeypatch.setattr(api, "_collected", refuse)
