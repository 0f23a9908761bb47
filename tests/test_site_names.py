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


def test_names_in_formulas_have_no_backslashes(monkeypatch):
    pytest.importorskip("sphinx")
    pytest.importorskip("latex2mathml")
    monkeypatch.syspath_prepend(DOCS / "_ext")
    formulas = importlib.import_module("formulas")
    latex = r"F < \sin(\texttt{corner\_angle}) \, h_0"
    found = formulas.mathml(latex, display=True)
    assert ">corner_angle</mtext>" in found
    assert "\\" not in found


def test_tables_with_much_text_are_lists_on_narrow_pages(monkeypatch):
    pytest.importorskip("sphinx")
    from docutils import nodes

    monkeypatch.syspath_prepend(DOCS / "_ext")
    unbroken = importlib.import_module("unbroken")

    def text_of(cell):
        inner = nodes.literal("", cell.strip("`")) if cell[0] == "`" else nodes.Text(cell)
        return nodes.paragraph("", "", inner)

    def table(*rows):
        cells = [[nodes.entry("", text_of(cell)) for cell in row.split("|")] for row in rows]
        body = nodes.tbody("", *(nodes.row("", *row) for row in cells))
        return nodes.table("", nodes.tgroup("", body, cols=len(cells[0])))

    words = "name|a default that is chosen|what this option does in one sentence"
    found = {
        "options": table(words, words),
        "two columns": table("name|what this option does in one sentence, and in another one"),
        "long names": table(f"`{'name' * 8}`|what this option does in one sentence"),
        "numbers": table("mesh|1 000 000 000 000|2 000 000 000 000 000 000 000 000 000 000 000"),
        "five columns": table("name|" + "|".join(["some more words"] * 4)),
        "five columns of text": table("name|" + "|".join(["what this option does"] * 4)),
        "seven columns": table("|".join(["a column of many words"] * 7)),
        "seven columns of text": table("|".join(["a column of a few more words"] * 7)),
    }
    document = nodes.document(None, None, "", *found.values())
    unbroken.keep_together(None, document)
    stacked = [name for name, one in found.items() if "stacked" in one["classes"]]
    assert stacked == ["options", "long names", "five columns of text"]
    dense = [name for name, one in found.items() if "dense" in one["classes"]]
    assert dense == ["seven columns of text"]
    assert found["long names"].next_node(nodes.literal)["classes"] == []
    reference = table("name|what this function does")
    reference["classes"].append("autosummary")
    code = table(f"`{'name' * 9}`|numbers")
    unbroken.keep_together(None, nodes.document(None, None, "", reference, code))
    assert reference["classes"] == ["autosummary", "stacked"]
    assert code.next_node(nodes.literal)["classes"] == ["long"]


def test_empty_cells_have_no_line_in_lists(monkeypatch):
    pytest.importorskip("sphinx")
    from docutils import nodes

    monkeypatch.syspath_prepend(DOCS / "_ext")
    unbroken = importlib.import_module("unbroken")
    cells = [nodes.entry("", nodes.paragraph("", text)) for text in ("name", "", "7", "words")]
    body = nodes.tbody("", nodes.row("", *cells))
    document = nodes.document(None, None, "", nodes.table("", nodes.tgroup("", body, cols=4)))
    unbroken.keep_together(None, document)
    assert ["empty" in cell["classes"] for cell in cells] == [False, True, False, False]


def test_no_line_of_a_page_becomes_a_list_by_its_first_sign():
    """Such as "+ 1" after a line break in a formula without marks."""
    for page in DOCS.rglob("*.md"):
        is_code = False
        for line in page.read_text().splitlines():
            is_code ^= line.lstrip().startswith("```")
            assert is_code or not line.lstrip().startswith(("+ ", "* ")), (page.name, line)


def test_the_number_of_a_field_is_no_description_of_it(monkeypatch):
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(DOCS / "_ext")
    names = importlib.import_module("names")
    own, python = ["Radius of the ball."], ["", "Alias for field number 0"]
    for lines in (own, python, empty := []):
        names.drop_aliases(None, "attribute", "radius", None, None, lines)
    assert (own, python, empty) == (["Radius of the ball."], [], [])


@pytest.mark.parametrize("colour", ["k", "black", "#000000", (0.0, 0.0, 0.0)])
def test_black_lines_are_refused_in_pictures_of_dark_pages(monkeypatch, tmp_path, colour):
    matplotlib = pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(DOCS.parent / "examples")
    with matplotlib.rc_context():
        drawings = importlib.import_module("_gallery")
        figure, (panel,) = drawings.drawing(1, 1, 100)
        panel.plot([0, 1], [0, 1], color=drawings.INK)
        drawings.save_drawing(tmp_path / "ink.png", figure)
        panel.plot([0, 1], [1, 0], color=colour, label="second order")
        with pytest.raises(ValueError, match="second order is black, which dark pages hide"):
            drawings.save_drawing(tmp_path / "black.png", figure)
    assert [path.name for path in tmp_path.iterdir()] == ["ink.png"]
