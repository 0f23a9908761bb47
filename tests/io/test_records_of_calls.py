"""What Python code wrote is made again from its record, or the record says why it cannot be."""

import gc
import json
import os
import pickle
import shutil
from decimal import Decimal
from fractions import Fraction
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from command_line import call

import adaptsize as ads
from adaptsize import _calls, _repeating
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


@pytest.fixture
def refused(capsys):
    """A call that fails, and what it prints as an error."""

    def run(*words):
        assert call(*words) == 1
        return capsys.readouterr().err

    return run


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


def _limited():
    mesh = ads.read("slit.vtu")
    h = ads.limit_gradient(mesh, mesh.point_data["h0"], 0.2)
    ads.write("made.vtu", ads.SizeFunction(mesh, h), fields={"limited": h}, record=True)


def _limited_with_info():
    mesh = ads.read("slit.vtu")
    method = ads.limiting.Exact(face_sources=False)
    h, info = ads.limit_gradient.with_info(mesh, mesh.point_data["h0"], 0.2, method=method)
    size = ads.SizeFunction(mesh, h, sources=info.sources)
    ads.write("made.vtu", size.clip(hmax=0.2), record=True)


def _on_a_grid():
    grid = ads.CartesianGrid([0.0, 0.0], 0.1, (11, 9))
    source = ads.PointSource([0.31, 0.22], 0.01)
    h = ads.limit_gradient(grid, ads.size_from_sources(grid, source), 0.2)
    ads.write("made.vti", ads.SizeFunction(grid, h), record=True)


def _family():
    family = ads.mesh_family(ads.read("slit.vtu").without_data(), hmax=0.3, levels=2)
    ads.write("made.vtu", family.meshes[1], fields={"h": family.sizes[1]}, record=True)


def _loop():
    """A loop with the solution of a solver in the first file, and errors estimated from it."""
    mesh = ads.read("slit.vtu").without_data()
    ads.write("solved.vtu", mesh, fields={"u": lambda points: np.tanh(9.0 * points[:, 0])})
    mesh = ads.read("solved.vtu")
    field = mesh.point_data["u"]
    for elements in (800, 1000):
        indicator = ads.zz_indicator(mesh, field)
        result = ads.adapt(
            mesh, indicator, elements=elements, fields={"u": field}, backend="bisection"
        )
        mesh, field = result.mesh, result.fields["u"]
    again = ads.size_from_hessian(mesh, field, elements=300)
    ads.write("made.vtu", mesh.without_data(), fields={"u": field, "next": again}, record=True)


SCRIPTS = {
    _size: "vtu", _remesh: "vtu", _elements: "vtu", _bounds: "vtu", _image: "vtu", _plain: "vtu",
    _limited: "vtu", _limited_with_info: "vtu", _on_a_grid: "vti", _family: "vtu", _loop: "vtu",
}  # fmt: skip


@pytest.mark.parametrize("script", SCRIPTS)
def test_what_python_wrote_is_made_again_bit_for_bit(script, folder, capsys):
    made = f"made.{SCRIPTS[script]}"
    if script in (_remesh, _elements, _family):
        pytest.importorskip("mmgpy")
    script()
    record = read_record(Path(made))
    assert record["unknown"] == []
    gc.collect()  # nothing is left of the objects
    capsys.readouterr()
    assert call("again", f"{made}.json", "--json") == 0
    assert json.loads(capsys.readouterr().out)["same"] is True
    # From elsewhere, with the inputs where they were.
    other = folder / "other"
    other.mkdir()
    for name in (made, f"{made}.json"):
        shutil.move(name, other)
    assert call("again", other / made, "-o", other / f"new.{SCRIPTS[script]}") == 0
    assert (other / f"new.{SCRIPTS[script]}").read_bytes() == (other / made).read_bytes()


def test_what_users_have_computed_or_changed_is_said(folder):
    """Such as the errors of a solver, and sizes that were changed after they were limited."""
    mesh = ads.read("slit.vtu")
    errors = np.hypot(*mesh.points[mesh.cells].mean(axis=1).T) + 0.1
    result = ads.adapt(mesh, errors, elements=9000, backend="bisection")
    shape = rf"\({mesh.n_cells},\) that no recorded call returned"
    with pytest.warns(InputWarning, match=f"indicator of adapt is an array of shape {shape}"):
        ads.write("made.vtu", result.mesh, record=True)
    h = ads.limit_gradient(mesh, mesh.point_data["h0"], 0.2)
    kept = ads.SizeFunction(mesh, h)  # it has a copy
    h *= 2.0
    assert _calls.origin_of(h) is None
    assert _calls.origin_of(kept.values).call.function == "limit_gradient"
    shape = rf"\({mesh.n_points},\) that no recorded call returned"
    with pytest.warns(InputWarning, match=f"fields of write is an array of shape {shape}"):
        ads.write("made.vtu", mesh, fields={"h": h}, record=True)
    limited = ads.limit_gradient(mesh, mesh.point_data["h0"], lambda h: 0.1 + 0.0 * h)
    with pytest.warns(InputWarning, match="g of limit_gradient is a function"):
        ads.write("made.vtu", ads.SizeFunction(mesh, limited), record=True)


def test_a_change_of_any_entry_is_noticed():
    """The checksum of a long array is put together from those of its parts."""
    mesh = ads.CartesianGrid([0.0, 0.0], 1.0, (250, 300)).mesh
    h = ads.limit_gradient(mesh, np.arange(1.0, mesh.n_points + 1.0), 0.5)
    n = _calls._BYTES // h.itemsize
    for change in ([0], [n - 1, n], [2 * n + 7, -1]):
        before = h[change]
        h[change] = before[::-1] + (len(change) == 1)
        assert _calls.origin_of(h) is None
        h[change] = before
        assert _calls.origin_of(h).call.function == "limit_gradient"


def test_a_mesh_that_is_kept_keeps_its_origin(folder):
    mesh = ads.read("slit.vtu").without_data()
    result = ads.adapt(mesh, h0=10.0, backend="bisection")
    assert result.mesh.n_cells == mesh.n_cells
    assert not result.remeshed
    assert _calls.origin_of(mesh).call.function == "SimplexMesh.without_data"


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
    for name in (
        "io.os.system", "warmup", "report", "SimplexMesh", "adapt.__globals__",
        "limit_gradient.__wrapped__", "limit_gradient.with_info.__globals__", "limit_metric",
        "limiting.limit.limit_gradient", "SizeFunction.plot", "SizeFunction.clip.__call__",
    ):  # fmt: skip
        record["calls"][0]["function"] = name
        path.write_text(json.dumps(record))
        assert call("again", path) == 1
        assert f"{name} is no function whose calls are recorded" in capsys.readouterr().err
    record["calls"][0] = {
        "function": "read", "arguments": {"path": {"class": "SimplexMesh", "fields": {}}}
    }  # fmt: skip
    path.write_text(json.dumps(record))
    assert call("again", path) == 1
    assert "SimplexMesh is no class whose objects are stored" in capsys.readouterr().err


def _pickled(marker):
    class Attack:
        def __reduce__(self):
            return os.mkdir, (str(marker),)

    return pickle.dumps(Attack(), protocol=0)


GLOBALS = ["__class__", "without_data", "__globals__"]
READ = {"function": "read", "arguments": {"path": "curved.vtu"}}
MESH = {"call": 0, "part": []}


@pytest.mark.parametrize(
    ("step", "text"),
    [
        ({"fields": {"mapping": [["h", {"call": 0, "part": GLOBALS}]]}}, "part"),
        ({"fields": {"call": 0, "part": ["point_data"]}}, "part"),
        ({"fields": {"call": 0, "part": ["point_data", "none"]}}, "none"),
        ({"fields": {"call": 0, "part": ["point_data", 3]}}, "part"),
        ({"obj": {"call": 0, "part": ["without_data"]}}, "part"),
        ({"obj": {"call": 0, "part": [["point_data"], "h"]}}, "part"),
        ({"obj": {"call": 0, "part": ["*"]}}, "part"),
        ({"obj": {"call": 0, "part": ["0"]}}, "part"),
        ({"obj": {"class": "SizeFunction", "fields": {"background": MESH}}}, "cannot be repeated"),
        (
            {"obj": {"class": "SizeFunction", "fields": {"background": MESH, "values": "a"}}},
            "values must be",
        ),
        ({"obj": {"class": "MetricFunction", "fields": {}}}, "MetricFunction is no class"),
        ({"obj": {"call": 1, "part": []}}, "call 1 is none of those before"),
        ({"obj": {"call": -1, "part": []}}, "call -1 is none of those before"),
        ({"obj": {"call": 7, "part": []}}, "call 7 is none of those before"),
        ({"progress": MESH}, "progress is no stored argument"),
        ({"unheard_of": 1}, "cannot be repeated"),
        ({"order": {"array": [1], "dtype": "O", "shape": []}}, "no type of numbers"),
        ({"order": {"array": [1], "dtype": "nonsense", "shape": []}}, "cannot be repeated"),
        ({"order": {"mapping": [[[], 1]]}}, "cannot be repeated"),
        ({"order": {"class": "PointSource", "fields": {"a": 1}}}, "cannot be repeated"),
        ({"order": {"class": "io.os", "fields": {}}}, "io.os is no class"),
        ({"order": {"other": 3}}, "is no stored value"),
    ],
)  # fmt: skip
def test_a_record_reaches_nothing_but_recorded_parts_of_results(folder, refused, step, text):
    """Not the modules that a mesh leads to, nor a pickle in the coordinates of a mesh."""
    ads.write("made.vtu", ads.read("curved.vtu"), record=True)
    path = Path("made.vtu.json")
    record = json.loads(path.read_text())
    record["calls"][-1]["arguments"] |= step
    path.write_text(json.dumps(record))
    printed = refused("again", path)
    assert "made.vtu.json: " in printed
    assert text in printed


GLOBALS_OF_LOOPS = ["__init__", "__globals__"]
LOOP = {"mesh": MESH, "h0": 10.0}
LIMITED = {"background": MESH, "h0": 1.0, "g": 0.2}


@pytest.mark.parametrize(
    ("function", "arguments", "parts"),
    [
        (
            "adapt",
            LOOP,
            [
                ["report"], ["original"], ["plot"], ["fields"], ["fields", "__class__"],
                ["fields", "none"], ["fields", "x", "ctypes"], ["mesh", "points"],
                ["mesh", "point_data"], ["mesh", "point_data", "x", "base"], ["__class__"],
                ["mesh", *GLOBALS_OF_LOOPS], ["mesh", "without_data"], ["size", "plot"],
            ],
        ),
        (
            "limit_gradient.with_info",
            LIMITED,
            [["2"], ["-1"], ["\u0661"], ["1"], ["1", "__class__"], ["1.sources"], [0], ["00", "x"]],
        ),
        ("limit_gradient", LIMITED, [["0"], ["base"], ["ctypes"], ["__array_interface__"]]),
    ],
)  # fmt: skip
def test_a_record_reaches_no_other_parts_of_loops(folder, refused, function, arguments, parts):
    if function == "adapt":
        pytest.importorskip("mmgpy")
    ads.write("made.vtu", ads.read("curved.vtu"), record=True)
    path = Path("made.vtu.json")
    record = json.loads(path.read_text())
    calls = [record["calls"][0], {"function": function, "arguments": arguments}]
    victim = folder / "victim.png"
    victim.write_text("mine")
    refusals = ["recorded part of what", "cannot be repeated", "returned no mesh", "must be"]
    before = {one.name for one in folder.iterdir()}
    for part, name in zip(parts, cycle(("obj", "fields")), strict=False):
        stored = {"call": 1, "part": part}
        given = {
            "obj": MESH,
            name: {"mapping": [["h", stored]]} if name == "fields" else stored,
        }
        last = {"function": "write", "arguments": {"path": "victim.png", **given}}
        path.write_text(json.dumps(record | {"calls": [*calls, last]}))
        printed = refused("again", path)
        assert any(text in printed for text in refusals)
    assert victim.read_text() == "mine"
    assert {one.name for one in folder.iterdir()} == before


def test_arguments_of_loops_are_no_functions_of_a_record(folder, refused):
    """What a loop calls are size functions, which a record makes of numbers only."""
    ads.write("made.vtu", ads.read("curved.vtu"), record=True)
    path = Path("made.vtu.json")
    record = json.loads(path.read_text())
    for argument in (
        {"project": "os.system"},
        {"project": {"call": 0, "part": ["without_data"]}},
        {"h0": {"call": 0, "part": GLOBALS}},
        {"h0": {"class": "FieldTransfer", "fields": {}}},
        {"fields": {"mapping": [["h", {"class": "ElementField", "fields": {}}]]}},
        {"progress": True},
    ):
        step = {"function": "adapt", "arguments": {**LOOP, **argument}}
        write = {"function": "write", "arguments": {"obj": {"call": 1, "part": ["mesh"]}}}
        path.write_text(json.dumps(record | {"calls": [record["calls"][0], step, write]}))
        assert "made.vtu.json: " in refused("again", path)


def test_an_attack_by_a_pickle_runs_nothing(folder, refused):
    marker = folder / "ran"
    content = np.frombuffer(_pickled(marker), np.uint8).tolist()
    pickle.loads(bytes(content))
    marker.rmdir()  # it would have worked
    ads.write("made.vtu", ads.read("curved.vtu"), record=True)
    path = Path("made.vtu.json")
    record = json.loads(path.read_text())
    loads = {"call": 0, "part": [*GLOBALS, "inspect", "sys", "modules", "pickle", "loads"]}
    record["calls"][-1]["arguments"]["fields"] = {"mapping": [["h", loads]]}
    record["calls"][-1]["arguments"]["obj"] = {
        "array": content, "dtype": "uint8", "shape": [len(content)]
    }  # fmt: skip
    path.write_text(json.dumps(record))
    assert "no recorded part of what read returned" in refused("again", path)
    assert not marker.exists()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"calls": []}, "calls must be a list of at least one call"),
        ({"calls": {}}, "calls is {}"),
        ({"calls": [3]}, "call 0 must have a function and arguments, got 3"),
        ({"calls": [READ]}, "the last call must be that of write"),
        ({"inputs": []}, "inputs is []"),
        ({"inputs": {"curved.vtu": 3}}, "inputs are {'curved.vtu': 3}"),
        ({"unknown": [3]}, "[3] are no texts"),
        ({"versions": 3}, "versions is 3"),
        ({"folder": None}, "folder is None"),
        ({"inputs": {}}, "curved.vtu is none of the inputs"),
    ],
)
def test_damaged_records_are_refused_with_their_names(folder, refused, change, text):
    ads.write("made.vtu", ads.read("curved.vtu"), record=True)
    path = Path("made.vtu.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    printed = refused("again", path)
    assert "made.vtu.json: " in printed
    assert text in printed
    assert call("info", "made.vtu") == 0  # it counts for nothing there


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
    for _ in range(_calls.MOST_CALLS - 2):
        mesh = mesh.without_data()
    ads.write("made.vtu", mesh, record=True)
    steps = read_record(Path("made.vtu"))["calls"]
    assert [step["function"] for step in steps[:2]] == ["read", "SimplexMesh.without_data"]
    before = [step["arguments"]["self"]["call"] for step in steps[1:-1]]
    assert before == [*range(_calls.MOST_CALLS - 2)]
    assert len(_calls.text_of_steps(steps)) < 1000
    with pytest.raises(_repeating.UnknownError, match="only the last step may write"):
        _repeating.repeated([steps[0], {"function": "write", "arguments": {}}, steps[1]], {})


def test_loops_keep_a_bounded_number_of_calls_and_of_numbers(folder):
    mesh = ads.read("curved.vtu")
    for _ in range(4 * _calls.MOST_CALLS):
        mesh = mesh.without_data()
        assert _calls.origin_of(mesh).call.length <= _calls.MOST_CALLS
    assert len(_calls.in_order(_calls.origin_of(mesh).call)) <= _calls.MOST_CALLS
    with pytest.warns(InputWarning, match="a loop of more than 500 calls"):
        ads.write("made.vtu", mesh, record=True)
    points = mesh.points[mesh.cells[:300]].mean(axis=1)
    size = ads.size_function(mesh, sources=[ads.PointSource(points, 0.1)])
    (source,) = _calls.origin_of(size).call.arguments["sources"]
    kept = source["fields"]["points"].values
    assert kept.nbytes == points.nbytes
    assert not kept.flags.writeable
    expected = points.copy()
    points[:] = 0.0  # as a script may do afterwards
    np.testing.assert_array_equal(kept, expected)
    # One budget for all the numbers of a call.
    describe = _calls.Describer()
    assert isinstance(describe(np.zeros(600)), _calls.Numbers)
    assert describe([[0.5] * 300, [0.5] * 300]) == _calls.Unknown(
        "a list with too much in it (a record has 1000 numbers)"
    )
    assert describe(np.zeros((201, 2))) == _calls.Unknown(
        "an array of shape (201, 2) that no recorded call returned"
    )
    assert isinstance(describe(np.zeros((200, 2))), _calls.Numbers)
    assert _calls.Describer()("x" * 200_000).text.startswith("a str with too much in it")


def _itself():
    held = [0.1]
    held.append(held)
    return held


class _Odd(dict):
    def items(self):
        raise KeyError("no items")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.longdouble(0.25), 0.25),
        (np.float32(0.25), 0.25),
        (np.int16(3), 3),
        (np.True_, True),
        (Fraction(1, 4), 0.25),
        (Decimal("0.25"), 0.25),
        (float("inf"), {"float": "inf"}),
        (2**70, _calls.Unknown("a very large number")),
        (1j, _calls.Unknown("a complex that no recorded call returned")),
        (np.datetime64("2020"), _calls.Unknown("a datetime64 that no recorded call returned")),
        (np.array([1j]), _calls.Unknown("an array of complex128")),
        (np.ma.masked_array([1.0], [True]), _calls.Unknown("a MaskedArray")),
        (_Odd(a=1), _calls.Unknown("a _Odd")),
        (_itself(), _calls.Unknown("a list with too much in it (a record has 1000 numbers)")),
    ],
)  # fmt: skip
def test_values_of_any_type_are_described(value, expected):
    assert _calls.Describer()(value) == expected


@pytest.mark.parametrize(
    "values",
    [
        np.arange(6, dtype=np.uint8).reshape(2, 3),
        np.array([0.1, np.nan, -np.inf], np.float32),
        np.array([0.1, 0.2], np.longdouble),
        np.array([1, 2], ">i4"),
        np.zeros((0, 2)),
        np.array(True),
    ],
)
def test_stored_arrays_keep_their_type_and_shape(values):
    stored = json.loads(json.dumps(_calls.Describer()(values).as_json(), allow_nan=False))
    found = _repeating.Decoder({})(stored)
    wanted = values.astype(float) if values.dtype == np.longdouble else values
    assert found.dtype.name == wanted.dtype.name
    assert found.shape == wanted.shape
    np.testing.assert_array_equal(found, wanted)


def _of_long_doubles(mesh):
    number = np.longdouble(0.2)
    source = ads.BallSource(mesh.points[3].astype(np.longdouble), np.longdouble(0.2), number)
    return ads.size_function(mesh, hmax=number, g=number, sources=[source])


def test_numbers_of_any_type_can_be_passed_and_are_stored(folder):
    mesh = ads.read("curved.vtu")
    ads.write("made.vtu", _of_long_doubles(mesh), record=True)
    assert call("again", "made.vtu") == 0
    ring = np.array([[0, 0], [2, 0], [2, 1], [0, 1]], np.longdouble)
    ads.write("made.vtu", ads.io.polygons(ring), record=True)
    assert call("again", "made.vtu") == 0


def test_bookkeeping_costs_no_result():
    class Odd:
        def __fspath__(self):
            raise KeyError("no path")

        @property
        def point_data(self):
            raise ZeroDivisionError

    for reads in (False, True):
        function = _calls.recorded("f", "missing", reads=reads)(lambda first: 7)
        for value in (Odd(), _itself(), np.longdouble(1)):
            assert function(value) == 7


def test_pixels_are_stored_with_their_type(folder):
    pixels = np.zeros((12, 12), np.uint8)
    pixels[3:9, 2:8] = 1
    ads.write("made.vtu", ads.mesh_image(pixels), record=True)
    image = read_record(Path("made.vtu"))["calls"][0]["arguments"]["image"]
    assert (image["dtype"], image["shape"]) == ("uint8", [12, 12])
    assert call("again", "made.vtu") == 0


@pytest.mark.parametrize("tolerance", [Fraction(1, 500), np.array(0.002), np.float32(0.002), 1])
def test_the_tolerance_is_stored_as_a_number(folder, capsys, tolerance):
    mesh = ads.read("curved.vtu").without_data()
    made = mesh.with_data(point_data={})
    describe = _calls.Describer()
    called = _calls.call_of("remesh", {"mesh": describe(mesh), "tolerance": describe(tolerance)})
    _calls._remember(made, _calls.Result(called))
    ads.write("made.vtu", made, record=True)
    stored = read_record(Path("made.vtu"))["tolerance"]
    assert isinstance(stored, float)
    assert stored == float(tolerance)
    assert call("check", "made.vtu", "--original", "curved.vtu") == 0
    assert f"with the tolerance {stored:.3g}" in capsys.readouterr().err


def test_a_record_that_cannot_be_written_leaves_the_file_as_it_was(folder):
    mesh = ads.read("curved.vtu")
    Path("made.vtu").write_text("before")
    Path("made.vtu.json").mkdir()
    with pytest.raises(ads.errors.MeshFileError, match="is a directory"):
        ads.write("made.vtu", mesh, record=True)
    assert Path("made.vtu").read_text() == "before"
    assert not [path for path in folder.iterdir() if path.name.startswith(".adaptsize")]


def test_a_record_of_another_content_is_not_believed(folder, capsys):
    mesh = ads.read("curved.vtu")
    ads.write("made.vtu", mesh.without_data(), record=True)
    assert call("info", "made.vtu") == 0
    assert "made by adaptsize" in capsys.readouterr().err
    ads.write("made.vtu", ads.read("slit.vtu"))
    assert call("info", "made.vtu") == 0
    printed = capsys.readouterr().err
    assert "made by" not in printed
    assert "made.vtu.json is the record of another content" in printed
    assert call("check", "made.vtu", "--report", "page.html") == 0
    assert "input made by" not in Path("page.html").read_text()


def test_inputs_are_found_after_the_folder_was_changed(folder, monkeypatch):
    mesh = ads.read("curved.vtu")
    (folder / "other").mkdir()
    monkeypatch.chdir("other")
    ads.write("made.vtu", mesh, record=True)
    assert read_record(Path("made.vtu"))["unknown"] == []
    assert call("again", "made.vtu") == 0
    # Two contents by one name are not mixed up.
    shutil.copy(folder / "slit.vtu", "curved.vtu")
    slit = ads.read("curved.vtu")
    size = ads.SizeFunction(slit, np.full(slit.n_points, 0.1))
    _calls._remember(size, _calls.Result(_calls.call_of(
        "f", {"a": _calls.origin_of(mesh), "b": _calls.origin_of(slit)}
    )))  # fmt: skip
    with pytest.warns(InputWarning, match="curved.vtu is missing, or has changed since"):
        ads.write("made.vtu", size, record=True)
