"""Fixtures of the tests of distributed meshes."""

import pytest

from adaptsize.limiting.in_parts import limit as api


@pytest.fixture
def nothing_is_collected(monkeypatch):
    def refuse(*args):
        raise AssertionError("the mesh was collected on one rank")

    monkeypatch.setattr(api, "_collected", refuse)
