"""Names in backticks become links on the site, and the logo is the one of its script."""

import importlib
from pathlib import Path

import pytest

import adaptsize

DOCS = Path(__file__).parents[1] / "docs"


def test_written_names_are_those_of_the_reference(monkeypatch):
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(DOCS / "_ext")
    names = importlib.import_module("names")
    found = names.public_names(DOCS / "api.rst")
    assert found["limit_gradient"] == "adaptsize.limit_gradient"
    assert found["SizeReport"].startswith("adaptsize.")
    assert "minimum" not in found
    written = "ads.limit_gradient(mesh, h0, g=0.25)"
    assert names.WRITTEN.match(written)[1] == "limit_gradient"
    for target in found.values():
        module, _, name = target.rpartition(".")
        assert hasattr(importlib.import_module(module), name)
    assert adaptsize.__name__ == "adaptsize"


def test_the_logo_is_the_one_of_the_script(monkeypatch):
    monkeypatch.syspath_prepend(DOCS / "_ext")
    logo = importlib.import_module("make_logo")
    assert logo.FILE.read_text(encoding="utf-8") == logo.picture()
    sides = [round(abs(t[1] - t[0])) for t in logo.triangles()]
    assert sides == [1, 1, 1, 2, 2, 3, 4, 5, 7, 9, 12]  # Padovan
