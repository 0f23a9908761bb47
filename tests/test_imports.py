"""What `import adaptsize` brings with it, in a fresh interpreter."""

import ast
import importlib
import importlib.resources
import json
import pkgutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import adaptsize

OPTIONAL = {
    *("meshio", "trimesh", "pytetwild", "mmgpy", "gmsh", "pyvista", "vtk", "matplotlib", "PIL"),
    *("tifffile", "nibabel", "nrrd", "mpi4py", "pymetis", "rich", "typer"),
}
HEAVY = {"numpy", "scipy", "numba"}


def _modules_after(code):
    text = (
        f"import sys, json\n{code}\nprint(json.dumps(sorted(m.split('.')[0] for m in sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


EVERY_NAME = "import adaptsize\nfor name in adaptsize.__all__: getattr(adaptsize, name)"
FTETWILD = "from adaptsize.remeshing.tetwild import _import_pytetwild; _import_pytetwild()"
#: Modules of child processes, which start for each call; numba alone would take a second.
CHILDREN = "from adaptsize.remeshing import _worker, gmsh, mmg, netgen, tetwild"
HELP = """
import io
from contextlib import redirect_stdout
from adaptsize.cli.entry import run
with redirect_stdout(io.StringIO()): run(["--help"])
"""


@pytest.mark.parametrize(
    ("code", "unwanted"),
    [
        ("import adaptsize", OPTIONAL | HEAVY),
        (EVERY_NAME, OPTIONAL),
        ("import adaptsize.plot", {"pyvista", "matplotlib", "vtk"}),
        (CHILDREN, {"numba", "scipy", "mmgpy", "gmsh"}),
        (FTETWILD, {"pyvista", "vtkmodules"}),
        (HELP, {"numba", "scipy", "meshio", "trimesh", "pyvista"}),
    ],
    ids=["package", "every name", "plot", "child processes", "fTetWild", "help"],
)
def test_nothing_is_imported_that_is_not_needed(code, unwanted):
    assert not _modules_after(code) & unwanted


def test_limiting_brings_no_mesh_or_picture_package_and_no_part_of_scipy_that_is_slow():
    code = (
        "import sys, scipy.linalg\n"  # numba imports it, and it imports scipy.sparse before 1.11
        "known = set(sys.modules)\n"
        "from adaptsize import SimplexMesh, limit_gradient\n"
        "mesh = SimplexMesh([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [[0, 1, 2]])\n"
        "limit_gradient(mesh, [0.1, 5.0, 5.0], 0.3)\n"
        "slow = {'scipy.' + name for name in ('ndimage', 'sparse', 'spatial', 'optimize')}\n"
        "assert not (slow & set(sys.modules)) - known, slow & set(sys.modules)"
    )
    assert not _modules_after(code) & OPTIONAL


def test_the_summary_of_a_file_brings_neither_bounds_nor_limiting():
    code = (
        "import sys, adaptsize.io\n"
        "from adaptsize.quality.summary import summarize\n"
        "slow = {'adaptsize.sizes', 'adaptsize.limiting', 'scipy.spatial'} & set(sys.modules)\n"
        "assert not slow, slow"
    )
    _modules_after(code)


def test_cached_kernels_are_loaded_without_the_compiler_and_scipy():
    # What compiles them takes longer to import than the rest of numba.
    code = (
        "import sys\n"
        "from adaptsize import SimplexMesh, limit_gradient\n"
        "mesh = SimplexMesh([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [[0, 1, 2]])\n"
        "assert abs(limit_gradient(mesh, [0.1, 5.0, 5.0], 0.3) - [0.1, 0.4, 0.4]).max() < 1e-12\n"
        "from adaptsize.background.topology import components_of\n"
        "from adaptsize.background.merging import place_numbers\n"
        "assert place_numbers(mesh.points, 1e-9).tolist() == [0, 1, 2]\n"
        "slow = 'numba.np.linalg numba.np.npyimpl scipy.linalg scipy.sparse scipy.spatial'\n"
        "loaded = [name for name in slow.split() if name in sys.modules]\n"
    )
    _modules_after(code)  # compiles them
    _modules_after(code + "assert not loaded, loaded")


def test_public_names_are_listed_and_the_objects_of_their_homes():
    assert len(set(adaptsize.__all__)) == len(adaptsize.__all__)
    assert set(adaptsize.__all__) <= set(dir(adaptsize))
    for name in adaptsize.__all__:
        assert getattr(adaptsize, name) is getattr(adaptsize, name)
    for name, home in adaptsize._HOMES.items():
        module = importlib.import_module(f"adaptsize.{home}")
        assert getattr(adaptsize, name) is getattr(module, name)
        assert name in module.__all__ if hasattr(module, "__all__") else True


SUBMODULES = [
    "adaptation", "background", "bridges", "distributed", "domain_size", "errors", "geometry",
    "io", "limiting", "metrics", "plot", "quality", "remeshing", "reporting", "sizes",
    "typing",
]  # fmt: skip


def test_a_submodule_is_an_attribute_after_importing_the_package_alone():
    assert "adaptsize" in _modules_after("import adaptsize; adaptsize.sizes.size_from_error")
    for name in SUBMODULES:  # others are attributes by now
        assert adaptsize.__getattr__(name) is importlib.import_module(f"adaptsize.{name}")


def test_every_public_submodule_is_listed():
    found = {info.name for info in pkgutil.iter_modules(adaptsize.__path__)}
    public = {name for name in found if not name.startswith("_")} - {"cli", "options", "ranks"}
    assert public == set(SUBMODULES)
    assert set(SUBMODULES) <= set(dir(adaptsize))


ROOT = Path(__file__).parent.parent
SCRIPTS = [p for room in ("benchmarks", "docs", "examples") for p in (ROOT / room).rglob("*.py")]


def test_scripts_that_no_test_runs_import_what_exists():
    names = {
        (node.module, name.name)
        for script in SCRIPTS
        for node in ast.walk(ast.parse(script.read_text("utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "adaptsize"
        for name in node.names
    }
    missing = [
        pair
        for pair in sorted(names)
        if find_spec(pair[0]) is None
        or not (hasattr(importlib.import_module(pair[0]), pair[1]) or find_spec(".".join(pair)))
    ]
    assert missing == []
    assert len(names) > 20
