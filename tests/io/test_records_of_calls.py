"""What Python code wrote is made again from its record, or the record says why it cannot be."""

import gc
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import call

import adaptsize as ads
from adaptsize import _calls
from adaptsize._records import read_record
from adaptsize.errors import InputWarning

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with some inputs."""
    for name in ("curved.vtu", "slit.vtu"):
        shutil.copy(DATA / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _sized(mesh):
    inside = mesh.points[mesh.cells[[5, 50]]].mean(axis=1)
    sources = [ads.PointSource(inside, 0.05), ads.BallSource(mesh.points[3], 0.2, 0.1)]
    return ads.size_function(mesh, sources=sources, g=np.float64(0.2), hmax=0.5)


def _size():
    ads.write("made.vtu", _sized(ads.read("curved.vtu")), record=True)


def _remesh():
    mesh = ads.read(Path("curved.vtu")).without_data()
    size = _sized(mesh)
    new = ads.remesh(mesh, size, tolerance=2e-3)
    ads.write("made.vtu", new, fields={"h": size}, record=True)


def _elements():
    made = ads.remesh_to_elements(ads.read(path="slit.vtu").without_data(), 300)
    ads.write("made.vtu", made.mesh, fields={"h": made.size}, record=True)


def _bounds():
    mesh = ads.read("slit.vtu")
    size = ads.size_function(mesh, h0=mesh.point_data["h0"], elements_across=0.0)
    ads.write("made.vtu", size, order=2, record=True)


def _image():
    pixels = np.zeros((12, 12), np.uint8)
    pixels[3:9, 2:8] = 1
    np.save("pixels.npy", pixels)
    ads.write("made.vtu", ads.mesh_image(ads.read_image("pixels.npy")), record=True)


def _plain():
    outline = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    ads.write("made.vtu", ads.io.polygons(outline), record=True)


@pytest.mark.parametrize("script", [_size, _remesh, _elements, _bounds, _image, _plain])
def test_what_python_wrote_is_made_again_bit_for_bit(script, folder, capsys):
    if script in (_remesh, _elements):
        pytest.importorskip("mmgpy")
    script()
    record = read_record(Path("made.vtu"))
    assert record["unknown"] == []
    gc.collect()  # nothing is left of the objects
    capsys.readouterr()
    assert call("again", "made.vtu.json", "--json") == 0
    assert json.loads(capsys.readouterr().out)["same"] is True
    # From elsewhere, with the inputs where they were.
    other = folder / "other"
    other.mkdir()
    for name in ("made.vtu", "made.vtu.json"):
        shutil.move(name, other)
    assert call("again", other / "made.vtu", "-o", other / "new.vtu") == 0
    assert (other / "new.vtu").read_bytes() == (other / "made.vtu").read_bytes()


def test_check_info_and_report_read_the_record(folder, capsys):
    pytest.importorskip("mmgpy")
    _remesh()
    capsys.readouterr()
    assert call("info", "made.vtu") == 0
    printed = capsys.readouterr().err
    assert "made by adaptsize" in printed
    assert "read(path='curved.vtu'), SimplexMesh.without_data(...), size_function(..., " in printed
    assert "remesh(..., tolerance=0.002)" in printed
    assert call("check", "made.vtu", "--original", "curved.vtu", "--report", "page.html") == 0
    assert "with the tolerance 0.002" in capsys.readouterr().err
    assert "remesh(..., tolerance=0.002)" in Path("page.html").read_text()
    mesh = ads.read("curved.vtu").without_data()
    ads.report("own.html", mesh)
    assert "made by</th><td>read(path=&#x27;curved.vtu&#x27;)" in Path("own.html").read_text()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"sources": [lambda x: 0.1 + x[:, 0] ** 2]}, "sources of size_function is a function"),
        ({"h0": np.full(2000, 0.1)}, r"h0 of size_function is an array of shape \(2000,\)"),
    ],
)
def test_what_cannot_be_stored_is_said(folder, capsys, options, text):
    mesh = ads.read("curved.vtu")
    if "h0" in options:
        options = {"h0": np.resize(options["h0"], mesh.n_points)}
        text = text.replace("2000", str(mesh.n_points))
    size = ads.size_function(mesh, **options)
    with pytest.warns(InputWarning, match=f"cannot be made again from it: {text}") as seen:
        ads.write("made.vtu", size, record=True)
    assert seen[0].filename == __file__
    assert call("again", "made.vtu.json") == 1
    assert "the record does not hold all: " in capsys.readouterr().err
    assert call("info", "made.vtu") == 0
    assert "it cannot be made again: " in capsys.readouterr().err


def test_meshes_from_elsewhere_and_files_that_have_changed_are_said(folder):
    mesh = ads.read("curved.vtu")
    own = ads.SimplexMesh(mesh.points, mesh.cells)
    with pytest.warns(InputWarning, match="obj of write is a SimplexMesh that no recorded call"):
        ads.write("made.vtu", own, record=True)
    shutil.copy("slit.vtu", "curved.vtu")
    with pytest.warns(InputWarning, match=r"curved\.vtu is missing, or has changed since"):
        ads.write("made.vtu", mesh, record=True)


def test_a_record_runs_nothing_but_recorded_functions_and_sources(folder, capsys):
    ads.write("made.vtu", ads.size_function(ads.read("curved.vtu")), record=True)
    path = Path("made.vtu.json")
    record = json.loads(path.read_text())
    for name in ("io.os.system", "warmup", "report", "SimplexMesh"):
        record["calls"][0]["function"] = name
        path.write_text(json.dumps(record))
        assert call("again", path) == 1
        assert f"{name} is no function whose calls are recorded" in capsys.readouterr().err
    record["calls"][0] = {
        "function": "read", "arguments": {"path": {"class": "SimplexMesh", "fields": {}}}
    }  # fmt: skip
    path.write_text(json.dumps(record))
    assert call("again", path) == 1
    assert "SimplexMesh is no source" in capsys.readouterr().err


def test_nothing_is_kept_alive_and_nothing_written_unless_requested(folder):
    before = len(_calls._KNOWN)
    mesh = ads.read("curved.vtu")
    size = ads.size_function(mesh)
    assert _calls.origin_of(size).call.function == "size_function"
    ads.write("made.vtu", size)
    assert not Path("made.vtu.json").exists()
    del mesh, size
    gc.collect()
    assert len(_calls._KNOWN) <= before


def test_fields_may_be_functions_of_the_points(folder):
    mesh = ads.read("curved.vtu")
    ads.write("made.vtu", mesh, fields={"x": lambda points: points[:, 0]})
    np.testing.assert_array_equal(ads.read("made.vtu").point_data["x"], mesh.points[:, 0])
    with pytest.raises(ValueError, match="fields may be functions for meshes"):
        ads.write("made.vti", ads.CartesianGrid([0, 0], 1.0, (3, 3)), fields={"x": len})


def test_long_chains_are_stored_in_order_and_only_the_last_step_writes(folder):
    mesh = ads.read("curved.vtu")
    for _ in range(2000):
        mesh = mesh.without_data()
    ads.write("made.vtu", mesh, record=True)
    steps = read_record(Path("made.vtu"))["calls"]
    assert [step["function"] for step in steps[:2]] == ["read", "SimplexMesh.without_data"]
    assert [step["arguments"]["self"]["call"] for step in steps[1:-1]] == [*range(2000)]
    assert len(_calls.text_of_steps(steps)) < 1000
    with pytest.raises(_calls.UnknownError, match="only the last step may write"):
        _calls.repeated([steps[0], {"function": "write", "arguments": {}}, steps[1]], {})
