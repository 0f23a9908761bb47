"""The site: names become links, numbers stay whole, the layout is checked; and the logo."""

import importlib
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"


def test_written_names_are_those_of_the_reference(monkeypatch):
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(DOCS / "_ext")
    names = importlib.import_module("names")
    found = names.public_names(DOCS / "api.rst")
    assert found["limit_gradient"] == "adaptsize.limit_gradient"
    assert found["SizeReport"].startswith("adaptsize.")
    assert "minimum" not in found
    assert set(names.records()) <= set(found.values())  # each is on a page that exists
    written = "ads.limit_gradient(mesh, h0, g=0.25)"
    assert names.WRITTEN.match(written)[1] == "limit_gradient"
    for target in found.values():
        module, _, name = target.rpartition(".")
        assert hasattr(importlib.import_module(module), name)
