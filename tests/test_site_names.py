"""The site: names become links, numbers stay whole, the layout is checked; and the logo."""

import importlib
import shutil
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


def test_the_logo_is_the_one_of_the_script(monkeypatch):
    monkeypatch.syspath_prepend(DOCS / "_ext")
    logo = importlib.import_module("make_logo")
    assert logo.FILE.read_text(encoding="utf-8") == logo.picture()
    sides = [round(abs(t[1] - t[0])) for t in logo.triangles()]
    assert sides == [1, 1, 1, 2, 2, 3, 4, 5, 7, 9, 12]  # Padovan


def test_numbers_options_and_words_in_tables_stay_readable(monkeypatch):
    nodes = pytest.importorskip("docutils.nodes")
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(DOCS / "_ext")
    unbroken = importlib.import_module("unbroken")
    text = nodes.paragraph("", "", nodes.Text("10 000 of 2 cells, 7 % of 3 4"))
    literals = [nodes.literal("", t) for t in ("--max-elements N", "a - b", "x 10 000")]
    entries = [
        nodes.entry("", nodes.paragraph("", "", nodes.Text(t))) for t in (".1 / 2", "a mesh")
    ]
    unbroken.keep_together(None, nodes.section("", text, *literals, *entries))
    assert text.astext() == "10\u00a0000 of 2 cells, 7\u00a0% of 3 4"
    assert [x["classes"] for x in (*literals, *entries)] == [["option"], [], [], ["number"], []]
    assert literals[2].astext() == "x 10 000"


def test_the_check_of_the_site_finds_defects_of_layout(monkeypatch, tmp_path, capsys):
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    monkeypatch.syspath_prepend(DOCS / "_ext")
    check_site = importlib.import_module("check_site")
    (tmp_path / "fine.html").write_text("<article><h1>Fine</h1></article>")
    (tmp_path / "tex.html").write_text("<article><h1>Left: \\(x\\)</h1></article>")
    (tmp_path / "wide.html").write_text(
        "<article><h1>Wide</h1><h3>Deep</h3><div style='width: 600px'>x</div>"
        "<a href='#'></a><script>missing()</script></article>"
    )
    assert check_site.main(tmp_path) == 1
    printed = capsys.readouterr().out
    expected = ["tex.html: has TeX"]
    if browser:
        expected += [
            "too wide for 400",
            "without text",
            "H3 out of order",
            "missing is not defined",
        ]
    assert [words for words in expected if words not in printed] == []
    assert "fine.html" not in printed
