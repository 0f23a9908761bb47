"""Messages that name options, and the lines that warnings are about."""

import ast
import pickle
import string
import subprocess
import sys
from functools import cached_property
from pathlib import Path
from typing import is_typeddict

import numpy as np
import pytest

import adaptsize as ads
from adaptsize import errors
from adaptsize._checks import warn_caller
from adaptsize._messages import Message, message_of
from adaptsize.cli import options as of_commands
from adaptsize.options import Option, options_of

SOURCES = sorted(Path(ads.__file__).parent.rglob("*.py"))
FLAGS = {"hmin": "--hmin", "g": "-g", "strict": "--strict", "target": "--target"}


@pytest.mark.parametrize(
    ("message", "in_python", "typed"),
    [
        (Message("plain"), "plain", "plain"),
        (Message("{hmin} of {}", "{g}"), "hmin of {g}", "--hmin of {g}"),
        (Message("{!r} {:.3g}", "a", 2.0 / 3.0), "'a' 0.667", "'a' 0.667"),
        (Message("{strict:True}!"), "strict=True!", "--strict!"),
        (Message("{target:'triangles'}"), "target='triangles'", "--target triangles"),
        (Message("{hmin:{:g}} or {other:2}", 0.5), "hmin=0.5 or other=2", "--hmin 0.5 or other=2"),
        (Message("a.vtu: {}", Message("{g} is {}", 3)), "a.vtu: g is 3", "a.vtu: -g is 3"),
        (Message.about("hmin[2]", "is bad"), "hmin[2] is bad", "--hmin[2] is bad"),
        (Message.joined(", ", map(Message.name, ["g", "x"])), "g, x", "-g, x"),
    ],
)
def test_options_have_the_names_of_python_and_those_that_are_typed(message, in_python, typed):
    assert (message, str(message)) == (in_python, in_python)
    assert message.typed(FLAGS) == typed
    copy = pickle.loads(pickle.dumps(message))
    assert (copy, copy.typed(FLAGS), copy.options) == (message, typed, message.options)


@pytest.mark.parametrize(
    ("call", "options"),
    [
        (lambda: ads.size_function(np.eye(8), elements=9, nodes=9), ("nodes", "elements")),
        (lambda: ads.size_function(np.eye(8), hmin=2.0, hmax=1.0), ("hmin", "hmax")),
        (lambda: ads.size_function(np.eye(8), g=-1.0), ("g",)),
        (lambda: ads.mesh_image(np.eye(8, dtype=int), label=1, threshold=1.0), ("label", "thresh")),
    ],
)
def test_errors_have_the_names_of_the_options(call, options):
    with pytest.raises(errors.OptionError) as caught:
        call()
    assert [name[:6] for name in caught.value.options] == [name[:6] for name in options]
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (str(copy), copy.options) == (str(caught.value), caught.value.options)
    assert message_of(copy).options == caught.value.options


def test_messages_name_options_that_exist():
    listed = {name for thing in vars(ads.options).values() if is_typeddict(thing)
              for name in options_of(thing)}  # fmt: skip
    listed |= {thing.name for thing in vars(of_commands).values() if isinstance(thing, Option)}
    listed |= {"quiet", "verbose", "speed", "cost", "parts", "close_holes", "least_width"}
    listed |= {"sources"}
    found = {}
    for file in SOURCES:
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Message":
                template = ast.literal_eval(node.args[0]) if _is_text(node.args[0]) else ""
                for name in _fields(template):
                    found.setdefault(name, f"{file.name}:{node.lineno}")
    assert len(found) > 15
    assert {name: place for name, place in found.items() if name not in listed} == {}


def _is_text(node):
    return isinstance(node, ast.Constant)


def _fields(template):
    return [field for _, field, _, _ in string.Formatter().parse(template) if field]


def test_all_warnings_are_issued_by_the_function_that_finds_the_line_of_the_caller():
    by_hand = [
        file.name
        for file in SOURCES
        if "warnings.warn" in file.read_text("utf-8") and file.name != "_checks.py"
    ]
    assert by_hand == []


def test_code_without_a_file_and_properties_between_are_not_the_caller():
    # As in the __init__ of a dataclass, and in a property that is computed once.
    code = """
def warn():
    warn_caller("far away", InputWarning)

class Thing:
    @cached_property
    def place(self):
        warn()
"""
    inside = {
        "__name__": "adaptsize.made",
        "warn_caller": warn_caller,
        "InputWarning": errors.InputWarning,
        "cached_property": cached_property,
    }
    exec(code, inside)
    with pytest.warns(errors.InputWarning, match="far away") as caught:
        _ = inside["Thing"]().place
    assert caught[0].filename == __file__


SCRIPT = """
import contextlib

import numpy as np
import adaptsize as ads

square = ads.CartesianGrid([0.0, 0.0], 1.0, (3, 3)).mesh
ads.write("square.vtu", square)
far = ads.SizeFunction(square, np.ones(9))
two = ads.SimplexMesh(
    np.concatenate([square.points, square.points + 9.0]),
    np.concatenate([square.cells, square.cells + 9]),
)
h0 = np.repeat([1.0, np.inf], 9)
ads.write("two.vtu", ads.SimplexMesh(np.concatenate([square.points] * 2), two.cells))


def use():
    ads.size_function(square, g=20.0)  # an option
    ads.size_from_curvature(square, crease_angle=0.5)  # another one, in radians
    ads.limit_gradient(two, h0, 1.0)  # of a function with an info
    ads.limit_gradient.with_info(two, h0, 1.0)  # of its other form
    ads.size_from_sources(square, ads.PointSource([9.0, 9.0], 1.0))  # of a source
    far([[1e4, 0.0]])  # of a call
    print(far.clip(hmax=0.5)([[1e4, 0.0]]))  # of a call in a call
    ads.read("two.vtu")  # of a file
    with contextlib.suppress(ads.errors.TooManyElementsError):  # before a generator starts
        ads.remesh(double, 1e-6, strict=True)  # of a repaired surface


cube = ads.CartesianGrid([0.0] * 3, 1.0, (2, 2, 2)).mesh.boundary().mesh
cells = cube.cells.copy()
cells[0] += cube.n_points
double = ads.SimplexMesh(np.concatenate([cube.points, cube.points]), cells)
use()
"""


def test_warnings_are_about_the_line_of_the_user(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    command = [sys.executable, "-W", "default", "script.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    heads = [line for line in done.stderr.splitlines() if "Warning:" in line]
    for number, line in enumerate(SCRIPT.splitlines(), start=1):
        about = [head for head in heads if f"script.py:{number}: " in head]
        assert len(about) == (1 if ")  # " in line else 0), (line, done.stderr)
    assert all("script.py:" in head for head in heads), heads
