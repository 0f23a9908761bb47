"""What a command wrote is made again from the record beside it."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import call

from adaptsize import read
from adaptsize._records import read_record

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with some inputs."""
    for name in ("curved.vtu", "slit.vtu"):
        shutil.copy(DATA / name, tmp_path)
    (tmp_path / "line.txt").write_text("0 0\n0.2 0.1\n0.4 0\n")
    (tmp_path / "part.toml").write_text("hmax = 0.4\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


COMMANDS = {
    "remesh": ["remesh", "curved.vtu", "--source", "curve:line.txt=0.05", "--options", "part.toml"],
    "number": ["remesh", "curved.vtu", "--elements", "300", "--fields", "none", "--plot", "a.png"],
    "size": ["size", "curved.vtu", "--source", "ball:0,0,0.2=0.1", "-g", "0.2"],
    "limit": ["limit", "slit.vtu", "--field", "h0", "-g", "0.2"],
}


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("suffix", [".vtu", ".msh"])
def test_a_file_is_made_again_bit_for_bit(name, suffix, folder, capsys):
    if COMMANDS[name][0] == "remesh":
        pytest.importorskip("mmgpy")
    output = f"made{suffix}"
    assert call(*COMMANDS[name], "-o", output) == 0
    record = read_record(Path(output))
    assert set(record["inputs"]) == {
        word
        for word in ("curved.vtu", "slit.vtu", "line.txt", "part.toml")
        if any(word in given for given in COMMANDS[name])
    }
    if name == "number":
        (folder / "a.png").unlink()
    capsys.readouterr()
    assert call("again", f"{output}.json", "--json") == 0
    assert json.loads(capsys.readouterr().out)["same"] is True
    assert not (folder / "a.png").exists()
    # From elsewhere, with the inputs where they were.
    other = folder / "other"
    other.mkdir()
    shutil.move(output, other)
    shutil.move(f"{output}.json", other)
    capsys.readouterr()
    assert call("again", other / output, "-o", other / f"new{suffix}") == 0
    lines = capsys.readouterr().err.splitlines()
    assert any(line.startswith(f"{output}: ") and "points, " in line for line in lines)
    assert (other / f"new{suffix}").read_bytes() == (other / output).read_bytes()


def test_inputs_that_have_changed_and_records_of_others_are_refused(folder, refused):
    assert call("size", "curved.vtu", "-o", "size.vtu", "-q") == 0
    shutil.copy("slit.vtu", "curved.vtu")
    assert "curved.vtu is not what it was" in refused("again", "size.vtu.json", code=1)
    (folder / "curved.vtu").unlink()
    assert "curved.vtu is missing" in refused("again", "size.vtu.json", code=1)
    (folder / "other.vtu.json").write_text('{"version": 3}')
    assert "other.vtu.json: is no record of adaptsize" in refused("again", "other.vtu.json", code=1)
    assert "must be a new file" in refused("again", "size.vtu", "-o", "slit.vtu")
    assert "no directory none" in refused("again", "size.vtu", "-o", "none/new.vtu", code=1)


def test_another_result_is_noticed_with_the_versions_that_have_changed(folder, capsys):
    assert call("size", "curved.vtu", "-o", "size.vtu") == 0
    path = folder / "size.vtu.json"
    record = json.loads(path.read_text())
    record |= {"sha256": "0" * 64, "versions": {**record["versions"], "numba": "0.1"}}
    path.write_text(json.dumps(record))
    capsys.readouterr()
    assert call("again", "size.vtu.json", "-o", "new.vtu") == 1
    assert "size.vtu: another file (then numba 0.1)" in capsys.readouterr().out
    np.testing.assert_array_equal(read("new.vtu").point_data["h"], read("size.vtu").point_data["h"])


def test_the_record_is_shown(folder, capsys):
    assert call("size", "curved.vtu", "-o", "size.vtu") == 0
    capsys.readouterr()
    assert call("info", "size.vtu", "--json") == 0
    printed = capsys.readouterr()
    assert "made by adaptsize" in printed.err
    assert json.loads(printed.out)["made"]["command"] == ["size", "curved.vtu"]


def _with_command(*words):
    assert call("size", "curved.vtu", "-o", "size.vtu", "-q") == 0
    path = Path("size.vtu.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"command": list(words)}))


@pytest.mark.parametrize(
    "words",
    [
        ["--plot", "victim.png"],
        ["--plot=victim.png"],
        ["--plot-causes", "victim.png"],
        ["--options", "pictures.toml"],
        ["-o", "victim.png"],
        ["--options", "pictures.toml", "--plot", "none/victim.png"],
    ],
)
def test_again_writes_no_other_files(folder, words, capsys):
    victim = folder / "victim.png"
    victim.write_text("mine")
    Path("pictures.toml").write_text('plot = "victim.png"\nplot-causes = "new.png"\n')
    before = {path.name for path in folder.iterdir()} | {"size.vtu", "size.vtu.json"}
    _with_command("size", "curved.vtu", *words)
    assert call("again", "size.vtu.json") == 0
    assert victim.read_text() == "mine"
    assert {path.name for path in folder.iterdir()} == before


def test_an_options_file_with_pictures_draws_them_only_once(folder, capsys):
    Path("pictures.toml").write_text('hmax = 0.4\nplot = "p.png"\n')
    assert call("size", "curved.vtu", "--options", "pictures.toml", "-o", "size.vtu") == 0
    Path("p.png").write_text("mine")
    assert call("again", "size.vtu.json") == 0
    assert Path("p.png").read_text() == "mine"


@pytest.mark.parametrize("word", ["again", "warmup", "info", "check", "--version", "none"])
def test_again_runs_only_commands_that_write_records(folder, refused, word):
    _with_command(word, "curved.vtu")
    printed = refused("again", "size.vtu.json", code=1)
    assert (
        f"size.vtu.json: the record is damaged: {word} is no command that writes a record"
        in printed
    )


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"command": ["size"]}, "command is ['size']"),
        ({"command": "size"}, "command is 'size'"),
        ({"command": ["size", 3]}, "are no texts"),
        ({"sha256": 3}, "sha256 is 3"),
    ],
)
def test_damaged_records_of_commands_are_refused(folder, refused, change, text):
    assert call("size", "curved.vtu", "-o", "size.vtu", "-q") == 0
    path = Path("size.vtu.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    printed = refused("again", path, code=1)
    assert "size.vtu.json: the record is damaged: " in printed
    assert text in printed
