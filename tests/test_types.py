"""The types that users of the package get: of names, options, results and methods.

Names of some packages are imported on first use, which type checkers cannot follow.  Their stubs
are generated: run this file as a script after a change of the public names.
"""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from page_code import blocks_of

ROOT = Path(__file__).parents[1]
#: Packages whose names are imported on first use.
LAZY = [
    "adaptsize",
    "adaptsize.domain_size",
    *(
        f"adaptsize.{name}"
        for name in ("geometry", "metrics", "plot", "quality", "remeshing", "reporting")
    ),
]
SETTINGS = """
[mypy]
check_untyped_defs = True
ignore_missing_imports = True
allow_redefinition = True
local_partial_types = True
show_error_codes = True
# Pages and examples know when a result has a report or sources.
strict_optional = False
[mypy-matplotlib.*,pyvista.*,scipy.*,skfem.*,numba.*]
follow_imports = skip
follow_imports_for_stubs = True
"""
#: Some pages go on from the names of a solver, and define a function instead of an object.
OF_PAGES = ("[name-defined]", "[used-before-def]", "[has-type]", "[no-redef]")
#: A user's script, and what is wrong in each line.
SCRIPT = {
    "import adaptsize as ads": "",
    "from adaptsize import SimplexMesh, read, remesh, size_function": "",
    "mesh = read('part.stl')": "",
    "size = size_function(mesh, hmax=3.0, progress=True)": "",
    "size_function(mesh, hmim=3.0)": 'Unexpected keyword argument "hmim"',
    "size_function(mesh, hmax='3')": 'Argument "hmax" to "size_function" has incompatible type',
    "number: int = size_function(mesh)": "Incompatible types in assignment",
    "new = remesh(mesh, size, target='triangles', strict=True)": "",
    "remesh(mesh, size, target='quads')": 'Argument "target" to "remesh" has incompatible type',
    "new.measures.sum() + size(new.points).min()": "",
    "new.mesures": '"SimplexMesh" has no attribute "mesures"',
    "mesh.tag_faces(angel=30.0)": 'Unexpected keyword argument "angel" for "tag_faces"',
    "tags: str = mesh.tag_faces(30.0)": "Incompatible types in assignment",
    "size.cost(degre=2)": 'Unexpected keyword argument "degre" for "cost"',
    "mesh.summarize().n_boundary_facet": '"MeshSummary" has no attribute "n_boundary_facet"',
    "h, info = ads.limit_gradient.with_info(mesh, 1.0, 0.25)": "",
    "info.n_change": '"LimitingInfo" has no attribute "n_change"',
    "step = ads.adapt(mesh, h0=size)": "",
    "step.mesh.measures.sum() + step.size(new.points).min()": "",
    "step.mesh.mesures": '"SimplexMesh" has no attribute "mesures"',
    "step.size.backgroud": '"SizeFunction" has no attribute "backgroud"',
    "in_parts = ads.distributed.PartitionedMesh.from_serial(mesh)": "",
    "values: int = ads.adapt(in_parts, h0=1.0).size": "Incompatible types in assignment",
    "ads.limit_gradient(mesh, 1.0, 0.25, metod='exact')": 'Unexpected keyword argument "metod"',
    "sources = [ads.PointSource([0, 0], 1.0), ads.BoundarySource(1.0)]": "",
    "mixed = [ads.PointSource([0, 0], 1.0), ads.CurveSource([[0, 0], [1, 0]], 1.0)]": "",
    "ads.size_from_sources(mesh, mixed)": "",
    "size_function(mesh, sources=sources)": "",
    "size_function(mesh, sources='a.vtu')": 'Argument "sources" to "size_function" has',
    "except_this: type[ValueError] = ads.errors.OptionError": "",
    "ads.sise_function": 'Module has no attribute "sise_function"',
    "from adaptsize.remeshing import remeshh": 'has no attribute "remeshh"',
}


def stub_of(package):
    """Return the stub of a package."""
    module = importlib.import_module(package)
    by_home = sorted((home, name) for name, home in module._HOMES.items())
    lines = [
        f'"""The names of `{package}` for type checkers; tests/test_types.py writes this file."""',
        "",
        *(f"from {package} import {name} as {name}" for name in getattr(module, "_SUBMODULES", ())),
        *(f"from {package}.{home} import {name} as {name}" for home, name in by_home),
        *(["", "__version__: str"] if "__version__" in module.__all__ else []),
        *("", "__all__ = [", *(f'    "{name}",' for name in sorted(module.__all__)), "]"),
    ]
    return "\n".join(lines) + "\n"


def path_of_stub(package):
    return Path(importlib.import_module(package).__file__).with_suffix(".pyi")


@pytest.mark.parametrize("package", LAZY)
def test_stubs_have_the_names_that_are_imported_on_first_use(package):
    assert path_of_stub(package).read_text(encoding="utf-8") == stub_of(package)


def test_every_package_with_names_on_first_use_has_a_stub():
    using = {
        path.parent for path in ROOT.glob("src/**/__init__.py") if "lazily(" in path.read_text()
    }
    assert using == {path_of_stub(package).parent for package in LAZY}


@pytest.fixture(scope="module")
def faults(tmp_path_factory):
    """What mypy finds in a user's script, the code of all pages, and the examples: by file."""
    folder = tmp_path_factory.mktemp("scripts")
    (folder / "mypy.ini").write_text(SETTINGS)
    (folder / "script.py").write_text("\n".join(SCRIPT))
    for page in [ROOT / "README.md", *ROOT.glob("docs/**/*.md")]:
        blocks = blocks_of(page.read_text("utf-8"))
        code = [block.code for block in blocks if block.kind == "python"]
        if code:
            name = "_".join(page.relative_to(ROOT).with_suffix("").parts).replace("-", "_")
            (folder / f"page_{name}.py").write_text("\n".join(code), "utf-8")
    for example in ROOT.glob("examples/*.py"):
        (folder / example.name).write_bytes(example.read_bytes())
    # The cache is that of all runs here: the first one takes some twenty seconds.
    cache = ROOT / ".mypy_cache" / "of-users"
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file=mypy.ini", f"--cache-dir={cache}", "."],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stderr == ""
    found = {}
    for file, number, fault in re.findall(r"^(.+?):(\d+): error: (.*)$", done.stdout, re.M):
        # The elements of a literal with several types are objects for mypy.
        is_of_literal = re.search(r'"object"|\[object\]', fault)
        if not (is_of_literal or (file.startswith("page_") and fault.endswith(OF_PAGES))):
            found.setdefault(file, []).append((int(number), fault))
    return found


def test_what_is_wrong_in_a_users_script_is_found_and_nothing_else(faults):
    found = dict(faults["script.py"])
    assert len(found) == len(faults["script.py"])
    for number, (line, fault) in enumerate(SCRIPT.items(), start=1):
        assert (fault in found.pop(number)) if fault else number not in found, line
    assert not found


@pytest.mark.parametrize("kind", ["page", "example"])
def test_the_code_of_pages_and_examples_has_the_right_types(faults, kind):
    files = {name: found for name, found in faults.items() if name != "script.py"}
    assert not {
        name: f for name, f in files.items() if name.startswith("page_") == (kind == "page")
    }


if __name__ == "__main__":
    for lazy in LAZY:
        path_of_stub(lazy).write_text(stub_of(lazy), encoding="utf-8")
