"""What is not the heart of the package can be deleted, and the rest works as before.

A room is a list of files that nothing else imports at once.  In a copy of the package without all
rooms, everything else is imported, and sizes are made, written and read.
"""

import ast
import json
import subprocess
import sys
from pathlib import Path
from shutil import copytree

import pytest

import adaptsize

PACKAGE = Path(adaptsize.__file__).parent
ROOMS = {
    "page of a mesh": ["reporting/page"],
    "shorelines": ["_formats/coastal"],
    "generator of implicit domains": ["remeshing/distmesh", "domain_size/images.py"],
    "family of meshes": ["domain_size/family.py"],
    "sparse sizes": ["domain_size/sparse.py"],
    "cost": ["domain_size/cost.py"],
    "parts": ["domain_size/parts.py"],
}
#: Programs of their own, which start when they are imported.
PROGRAMS = ("__main__", "_worker", "_children")

WORK = """
import importlib, json, sys

sys.path.insert(0, sys.argv[1])
for name in json.loads(sys.argv[2]):
    importlib.import_module(name)
import numpy as np
import adaptsize as ads
from adaptsize.cli import main
from adaptsize.domain_size.reports import report_of

assert ads.__file__.startswith(sys.argv[1]), ads.__file__
square = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
size = ads.size_function(square, dofs=2000, degree=2)
assert 400 < report_of(size).n_elements < 1200
path = sys.argv[1] + "/square.vtu"
ads.write(path, size)
assert np.array_equal(ads.read_size(path).values, size.values)
assert ads.needs_remeshing(square, ads.limit_gradient(square, [0.1, *3 * [np.inf]], 0.3))
assert main(["info", path]) == 0
"""


def module_of(path):
    """The dotted name of a file or folder of the package."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


def imported_at_once(tree):
    """The modules, and names in them, that code imports when it is itself imported."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from imported_at_once(node)


@pytest.fixture(scope="module")
def imports():
    """What each file of the package imports at once."""
    files = [path for path in PACKAGE.rglob("*.py") if "_kernels" not in path.parts]
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in files}
    return {path: set(imported_at_once(tree)) for path, tree in trees.items()}


@pytest.mark.parametrize("name", ROOMS)
def test_nothing_else_needs_a_room_to_be_imported(imports, name):
    rows = [PACKAGE / row for row in ROOMS[name]]
    rooms = [module_of(row) for row in rows]
    seen = 0
    for path, names in imports.items():
        found = [n for n in names if any(f"{n}.".startswith(f"{room}.") for room in rooms)]
        if any(path.is_relative_to(row) for row in rows):
            seen += 1
        else:
            assert not found, path
    assert seen >= len(rows)


def test_all_rooms_can_be_deleted_at_once(tmp_path):
    rows = [PACKAGE / row for room in ROOMS.values() for row in room]
    assert all(row.exists() for row in rows)
    kernels = PACKAGE / "_kernels"  # stay in their place, to be compiled once

    def ignored(directory, names):
        return [n for n in names if n == "__pycache__" or Path(directory, n) in [*rows, kernels]]

    copy = Path(copytree(PACKAGE, tmp_path / "adaptsize", ignore=ignored))
    (copy / "_kernels").mkdir()
    (copy / "_kernels" / "__init__.py").write_text(f"__path__ = [{str(kernels)!r}]\n")
    modules = [
        ".".join(path.relative_to(tmp_path).with_suffix("").parts).removesuffix(".__init__")
        for path in sorted(copy.rglob("*.py"))
        if path.stem not in PROGRAMS
    ]
    found = subprocess.run(
        [sys.executable, "-c", WORK, str(tmp_path), json.dumps(modules)],
        capture_output=True, text=True, check=False, timeout=240,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr[-2000:]
