"""Options: groups in the help, refusals before anything is read, completion, and TOML files."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from command_line import call

from adaptsize import SimplexMesh, write
from adaptsize.cli.commands import app

DATA = Path(__file__).parents[2] / "data"
COMMANDS = typer.main.get_command(app).commands
#: What else each command needs.
WORDS = {
    "limit": ["in.vtu", "-o", "o.vtu", "-g", "0.3"],
    "adapt": ["in.vtu", "-o", "o.vtu", "--field", "u"],
    "check": ["in.vtu"],
    "info": ["in.vtu"],
} | {name: ["in.vtu", "-o", "o.vtu"] for name in ("size", "remesh", "family", "image")}
NUMBERS = [
    (name, option.opts[-1])
    for name, command in COMMANDS.items()
    for option in command.params
    if option.metavar in ("N", "LENGTH", "DEGREES")
    and option.name not in ("rounds", "levels", "degree", "components", "order", "seed")  # whole
]


@pytest.mark.parametrize("name", COMMANDS)
def test_help_is_complete_and_fits_on_a_screen_and_a_half(capsys, monkeypatch, name):
    monkeypatch.setenv("COLUMNS", "80")
    assert call(name, "-h") == 0
    printed = capsys.readouterr().out
    flags = [flag for option in COMMANDS[name].params for flag in option.opts if "-" in flag]
    assert all(flag in printed for flag in [*flags, "--json", "-q, --quiet", "-v, --verbose"])
    assert printed.count("\n") <= 84
    if name == "remesh":
        assert "Gradient limit: growth of sizes per length.  [0.25]\n" in printed
        titles = ["Output", "Sizes", "Number of elements", "Mesh generator", "General"]
        assert all(f"\n{title}:\n" in printed for title in titles)


@pytest.mark.parametrize(("name", "flag"), NUMBERS)
def test_what_is_no_number_is_one_line_before_anything_is_read(refused, name, flag):
    assert f": {flag} must be " in refused(name, *WORDS[name], flag, "nan")


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (["--hmin", "2", "--hmax", "1"], 2, "--hmin must be at most --hmax = 1, got 2"),
        (["--elements", "9e3", "--max-elements", "9e4"], 2, "--elements and --max-elements excl"),
        (["--field", "h_nan"], 1, "field 'h_nan' must not be nan, got field 'h_nan'[1]"),
        (["--field", "none"], 2, "--field must be a nodal field of the mesh (h_nan), got 'none'"),
        (["--crease-angle", "181"], 2, "--crease-angle must be at most 180 degrees, got 181"),
    ],
)
@pytest.mark.parametrize("command", ["size", "remesh"])
def test_bad_options_are_one_line_and_leave_no_file(
    refused, tmp_path, command, words, code, expected
):
    mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    write(tmp_path / "in.vtu", mesh, fields={"h_nan": [1.0, np.nan, 1.0]})
    err = refused(command, tmp_path / "in.vtu", "-o", tmp_path / "out.vtu", *words, code=code)
    assert err.startswith(f"adaptsize: error: {expected}")
    assert [path.name for path in tmp_path.iterdir()] == ["in.vtu"]


def test_the_shell_completes_options_and_backends():
    def completed(words):
        variables = {
            "_ADAPTSIZE_COMPLETE": "complete_bash",
            "COMP_WORDS": words,
            "COMP_CWORD": str(len(words.split(" ")) - 1),
        }
        command = [sys.executable, "-m", "adaptsize"]
        return subprocess.check_output(command, env=os.environ | variables, text=True).split()

    assert completed("adaptsize remesh --bac") == ["--backend"]
    assert completed("adaptsize remesh --backend ") == ["auto", "mmg", "tetwild"]


@pytest.fixture
def part(tmp_path):
    """Write a file of options."""

    def write_text(text):
        (tmp_path / "part.toml").write_text(text)
        return tmp_path / "part.toml"

    return write_text


def test_options_of_a_file_are_those_of_the_command_line(capsys, tmp_path, part):
    words = ["--hmin", "0.01", "--elements-per-radian", "0", "--source", "point:0,0=0.02"]
    text = 'hmin = 0.01\nelements-per-radian = 0\nsource = "point:0,0=0.02"\nhmax = 0.3\ng = 0.5'
    printed = []
    for given in (["--hmax", "0.1", "-g", "0.5", *words], ["--options", part(text)]):
        # One on the command line wins over the file.
        command = ["size", DATA / "lshape.vtu", "-o", tmp_path / "h.vtu", *given]
        assert call(*command, "--hmax", "0.1", "--json") == 0
        printed.append(json.loads(capsys.readouterr().out)["size"])
    assert printed[0] == printed[1]
    assert (printed[1]["g"], printed[1]["hmax"]) == (0.5, 0.1)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("elemnts = 9", "unknown option 'elemnts': did you mean 'elements'?"),
        ("frob = 9", "unknown option 'frob': the command's help lists them"),
        ("hmax = -1", "--hmax must be finite and > 0, got -1"),
        ('hmax = "1"', "--hmax must be a number, got '1'"),
        ("field = 3", "--field must be a text, got 3"),
        ("label = 0.5", "--label must be one or several of type int"),
        ("hmax = ", "is not TOML: "),
        (None, "No such file or directory"),
    ],
)
def test_bad_files_of_options_are_refused_with_their_name(refused, tmp_path, part, text, expected):
    file = tmp_path / "part.toml" if text is None else part(text)
    is_unreadable = "TOML" in expected or text is None
    err = refused(
        "size", "in.vtu", "-o", "o.vtu", "--options", file, code=1 if is_unreadable else 2
    )
    assert f"adaptsize: error: {file}: {expected}" in err
