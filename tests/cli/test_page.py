"""The page on the command line: its listings, options and keys are those of the program."""

import dataclasses
import json
import re
from pathlib import Path

import pytest
import typer
from page_code import blocks_of

from adaptsize import __version__
from adaptsize.cli.commands import app
from adaptsize.cli.entry import run
from adaptsize.quality.conformity import Conformity
from adaptsize.quality.summary import MeshSummary

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")
SHOWN = [block for block in blocks_of(PAGE) if block.output]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "data").symlink_to(ROOT / "data", target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_commands_print_what_the_page_shows(folder):
    pytest.importorskip("mmgpy")
    assert [block.code.split()[1] for block in SHOWN] == ["remesh"]
    for block in SHOWN:
        assert block.difference(block.run("docs/command-line.md", {})) is None


def test_every_option_on_the_page_exists():
    group = typer.main.get_command(app)
    known = {"--debug", "--install-completion", "--show-completion"}
    for command in [group, *group.commands.values()]:
        known |= {name for parameter in command.params for name in parameter.opts}
    known |= {"-h", "--help"}
    named = set(re.findall(r"(?<![\w-])(--?[a-zA-Z][a-z-]*)\b", PAGE))
    assert named <= known


def test_every_command_is_on_the_page():
    for name in typer.main.get_command(app).commands:
        assert f"adaptsize {name}" in PAGE, name


#: Keys that are always there.
SHARED = {"command", "version", "output", "warnings", "steps", "seconds", "units"}
KEYS = {
    "info": {"input", "n_points", "n_cells", "kind", "lower", "upper", "measure", "angle_min"},
    "check": {"input", "n_points", "n_cells", "edges", "radius_ratio_min", "angle_min"},
    "limit": {"input", "method", "g", "n_points", "n_lowered", "cell_gradient_quantiles"},
    "size": {"input", "size"},
}


@pytest.mark.parametrize(
    "words",
    [
        ["info", "data/lshape.vtu"],
        ["check", "data/slit.vtu", "--field", "h0"],
        ["limit", "data/slit.vtu", "--field", "h0", "-g", "0.3", "-o", "o.vtu"],
        ["size", "data/lshape.vtu", "-o", "o.vtu"],
        ["info", "none.vtu"],
    ],
    ids=["info", "check", "limit", "size", "error"],
)
def test_json_is_one_object_with_the_keys_on_the_page(folder, capsys, words):
    code = run([*words, "--json"])
    printed = capsys.readouterr()
    result = json.loads(printed.out, parse_constant=pytest.fail)  # no NaN
    assert code == 0 or printed.err == f"adaptsize: error: {result['error']}\n"
    assert (result["command"], result["version"]) == (words[0], __version__)
    assert SHARED | ({"error"} if code else KEYS[words[0]]) <= set(result)
    assert all(step["seconds"] >= 0.0 for step in result["steps"])
    for file in result["output"]:
        assert (file["file"], file["n_cells"] > 0, "h" in file["fields"]) == ("o.vtu", True, True)
    rows = dict(re.findall(r"^\| (\S+) \| (.*) \|$", PAGE.replace("`", ""), re.MULTILINE))
    listed = {"input", *re.findall(r"\w+", rows["all"]), *re.findall(r"\w+", rows[words[0]])}
    for record in (MeshSummary, Conformity):
        if record.__name__ in listed:
            listed |= {field.name for field in dataclasses.fields(record)}
    assert set(result) <= listed
    assert set(result.get("size", ())) <= listed
    assert all(set(file) <= listed for file in result["output"])
