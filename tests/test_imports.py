"""What `import adaptsize` brings with it, in a fresh interpreter."""

import importlib
import json
import subprocess
import sys

import pytest

import adaptsize

OPTIONAL = (
    "meshio",
    "trimesh",
    "pytetwild",
    "mmgpy",
    "gmsh",
    "pyvista",
    "vtk",
    "matplotlib",
    "PIL",
    "tifffile",
    "nibabel",
    "nrrd",
    "rich",
    "typer",
)
HEAVY = ("numpy", "scipy", "numba")


def _modules_after(code):
    text = (
        f"import sys, json\n{code}\nprint(json.dumps(sorted(m.split('.')[0] for m in sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


def test_import_alone_brings_nothing_that_is_slow():
    assert not _modules_after("import adaptsize") & {*OPTIONAL, *HEAVY}


def test_every_public_name_resolves_without_optional_packages():
    code = "import adaptsize\nfor name in adaptsize.__all__: getattr(adaptsize, name)"
    assert not _modules_after(code) & set(OPTIONAL)


def test_limiting_brings_no_mesh_or_picture_package():
    code = (
        "from adaptsize import SimplexMesh, limit_gradient\n"
        "limit_gradient(SimplexMesh([[0.0], [1.0]], [[0, 1]]), [0.1, 5.0], 0.3, method='exact')"
    )
    assert not _modules_after(code) & set(OPTIONAL)


def test_every_public_name_is_listed_and_resolves():
    for name in adaptsize.__all__:
        assert getattr(adaptsize, name) is getattr(adaptsize, name)
        assert name in dir(adaptsize)
    assert len(set(adaptsize.__all__)) == len(adaptsize.__all__)


def test_public_names_are_the_objects_of_their_homes():
    for name, home in adaptsize._HOMES.items():
        module = importlib.import_module(f"adaptsize.{home}")
        assert getattr(adaptsize, name) is getattr(module, name)
        assert name in module.__all__ if hasattr(module, "__all__") else True


def test_unknown_names_are_attribute_errors():
    with pytest.raises(AttributeError, match="module 'adaptsize' has no attribute 'refine'"):
        _ = adaptsize.refine
