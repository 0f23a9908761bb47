"""What the pages say is so: their commands run, and nothing is left out of the site.

Commands run word for word in a folder whose ``data`` are coarser files of the same names;
where that does not make them quick, COARSER lists what is replaced.  Links, references and
formulas are checked by Sphinx, in .ci/run.
"""

import importlib
import importlib.util
import inspect
import re
import shutil
import subprocess
import sys
import typing
from pathlib import Path

import numpy as np
import pytest

import adaptsize as ads
from adaptsize.cli.entry import run as run_command_line
from adaptsize.remeshing import available_backends

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [
    "README.md",
    "docs/index.md",
    "docs/install.md",
    *sorted(f"docs/how-to/{p.name}" for p in DOCS.glob("how-to/[a-z]*.md") if p.stem != "dolfinx"),
    *sorted(f"docs/tutorials/{p.name}" for p in DOCS.glob("tutorials/[a-z]*.md")),
]
FIRST = "adaptsize remesh data/bracket.stl -o bracket.vtu --plot bracket.png"
COARSER = {
    # The first line runs on the page that is about it.
    "README.md": [(FIRST, ""), ("range(6)", "range(2)"), ("1000 *", "150 *")],
    "docs/index.md": [(FIRST, ""), ("range(6)", "range(2)"), ("1000 *", "150 *")],
    "docs/how-to/stl.md": [(FIRST, f"{FIRST} --hmax 6"), ("-o size.vtu", "-o size.vtu --hmax 6")],
    "docs/how-to/vtk.md": [
        ("region:2=1 ", "region:2=5 "),
        ("30,10,10,2=0.5", "30,10,10,2=4.0"),
        ("--hmax 4", "--hmax 8"),
        ("RegionSource(2, 1.0)", "RegionSource(2, 5.0)"),
        ("tolerance=0.5, hmin=0.5, hmax=4.0", "tolerance=2.0, hmin=6.0, hmax=8.0"),
    ],
    "docs/how-to/image.md": [],
    "docs/how-to/fem-loop.md": [("(1000, 2000, 4000, 8000)", "(100, 200)")],
    "docs/how-to/export.md": [],
    "docs/install.md": [("adaptsize warmup", "")],
    "docs/tutorials/coast.md": [
        ("12_000", "1_200"),
        ("8_000", "800"),
        ("0.5)\nb =", "4.0)\nb ="),
        ("h_shore = 1.0", "h_shore = 8.0"),
    ],
    "docs/tutorials/cad.md": [
        ('"flange.step")\nprint', '"flange.step", elements_per_circle=16, largest=10.0)\nprint'),
        ("(3, 1.0)", "(3, 4.0)"),
        ("(0.6, tags=foot)", "(3.0, tags=foot)"),
        ("elements_across=1, full", "elements_per_radian=1.5, elements_across=0, full"),
        ("2.0, 0.5)", "2.0, 2.0)"),
        ("remesh(part, size)", "remesh(part, size, tolerance=0.02)"),
        ("remesh(solid, finer)", "remesh(solid, finer, tolerance=0.02)"),
    ],
    "docs/tutorials/flow.md": [
        ("adapted(4000, g)", "adapted(500, g, 2)"),
        ("hmin=0.005", "hmin=0.02"),
        ("first_height=1e-3", "first_height=1e-2"),
        ("< 1e-3) &", "< 1e-2) &"),
    ],
    "docs/tutorials/photonics.md": [
        ("a / 96, (97, 97)", "a / 24, (25, 25)"),
        ("1.0, 12.0", "1.0, 4.0"),
    ],
    "docs/tutorials/vessels.md": [("hmin=0.5", "hmin=1.5")],
    "docs/tutorials/seismic.md": [("per_wavelength = 5.0, 5.0", "per_wavelength = 2.0, 4.0")],
}  # fmt: skip
BLOCK = re.compile(
    r"^(?:<!-- needs: (?P<needs>\S+) -->\n)?```(?P<kind>sh|python)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


@pytest.fixture(scope="module")
def extension():
    """Import the module that makes the gallery."""
    spec = importlib.util.spec_from_file_location("docs_gallery", DOCS / "_ext" / "gallery.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look it up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def coarse_data(tmp_path_factory):
    """Return a folder of files named as those in data/, quick to mesh."""
    image = pytest.importorskip("PIL.Image", reason="a how-to reads a picture")
    nibabel = pytest.importorskip("nibabel", reason="a how-to reads a volume")
    folder = tmp_path_factory.mktemp("coarse")
    for name in ("slit.vtu", "block.vtu", "lshape.vtu"):
        shutil.copy(ROOT / "data" / name, folder)
    corners = np.array([[x, y, z] for x in (0, 20) for y in (0, 12) for z in (0, 8)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    halves = [[a, b, c] for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]
    ads.write(folder / "bracket.stl", ads.SimplexMesh(corners, halves))
    picture = image.open(ROOT / "data" / "objects.png")
    picture.resize((picture.width // 4, picture.height // 4), image.Resampling.NEAREST).save(
        folder / "objects.png"
    )
    volume = nibabel.load(ROOT / "data" / "organs.nii.gz")
    every = np.asarray(volume.dataobj)[::4, ::4, ::4]
    wider = volume.affine @ np.diag([4.0, 4.0, 4.0, 1.0])
    nibabel.save(nibabel.Nifti1Image(every, wider), folder / "organs.nii.gz")
    return folder


@pytest.fixture
def workplace(coarse_data, tmp_path, monkeypatch):
    """Change to a folder with coarse data."""
    (tmp_path / "data").symlink_to(coarse_data, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def solve(points, cells):
    """A field and an indicator, in the place of a solver."""
    u = np.hypot(*points.T) ** (2.0 / 3.0)
    return u, ads.zz_indicator(ads.SimplexMesh(points, cells), u)


def there_is(need):
    """Whether what a block needs beside this package is installed."""
    if need in (None, "solve"):
        return True
    return bool(find_program(need)) or importlib.util.find_spec(need) is not None


def find_program(name):
    return shutil.which(name) or shutil.which(name, path=str(Path(sys.executable).parent))


def run_line(line):
    """Run a line of a shell block; pip has run already where the tests run."""
    if not line or line.startswith("pip"):
        return
    program, *arguments = line.split()
    if program == "adaptsize":
        # Meshes of the coarse part differ in each run, and may miss a demand of check.
        allowed = (0, 1) if arguments[0] == "check" else (0,)
        assert run_command_line(arguments) in allowed, line
    else:
        subprocess.run([find_program(program), *arguments], check=True, capture_output=True)


@pytest.mark.timeout(900)  # fTetWild, and kernels to be compiled, on a busy machine
@pytest.mark.skipif(not available_backends()["mmg"].installed, reason="the pages use Mmg")
@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run(page, workplace):
    pytest.importorskip("pyvista", reason="some commands draw")
    text = (ROOT / page).read_text(encoding="utf-8")
    for asked, coarser in COARSER[page]:
        assert asked in text, f"{page} has no {asked!r} any more"
        text = text.replace(asked, coarser)
    blocks = list(BLOCK.finditer(text))
    assert blocks, page
    # Only what is under test may be left out: the second line of the README runs the tests.
    names = {"__name__": "page", "solve": solve}
    for block in blocks:
        if not there_is(block["needs"]):
            continue
        if block["kind"] == "python":
            line = text.count("\n", 0, block.start("code"))
            exec(compile("\n" * line + block["code"], str(ROOT / page), "exec"), names)
            continue
        for line in block["code"].splitlines():
            if "pytest" not in line:
                run_line(line.split("&&")[-1].strip())


def test_the_first_block_of_the_readme_is_what_ci_runs():
    first = next(BLOCK.finditer((ROOT / "README.md").read_text(encoding="utf-8")))
    lines = first["code"].splitlines()
    assert first["kind"] == "sh"
    assert len(lines) == 2
    assert lines[1].startswith('pip install -e ".[')
    assert "docs" in lines[1]
    assert lines[1].endswith("&& python -m pytest -n 2")


def test_every_public_name_is_in_the_reference():
    text = (DOCS / "api.rst").read_text(encoding="utf-8")
    listed = set(re.findall(r"^   ([A-Za-z_.]+)$", text, re.MULTILINE))
    missing = [n for n in ads.__all__ if n != "__version__" and n not in listed]
    assert missing == []


@pytest.mark.parametrize("module", ads._SUBMODULES)
def test_every_public_name_of_a_submodule_is_in_the_reference(module):
    text = (DOCS / "api.rst").read_text(encoding="utf-8")
    listed = set(re.findall(r"^   ([A-Za-z_.]+)$", text, re.MULTILINE))
    home = getattr(ads, module)
    own = [name for name, value in vars(home).items() if inspect.isclass(value)]
    names = getattr(home, "__all__", own)
    # Aliases of types are explained where they are used.
    public = [n for n in names if inspect.isclass(getattr(home, n)) or callable(getattr(home, n))]
    public = [n for n in public if typing.get_origin(getattr(home, n)) is None]
    assert public
    assert [n for n in public if not {n, f"{module}.{n}"} & listed] == []


def test_the_page_of_parameters_has_every_function_with_its_signature(monkeypatch):
    monkeypatch.syspath_prepend(DOCS / "_ext")
    page = importlib.import_module("signatures").page(DOCS / "api.rst")
    rows = {row.split("`")[1]: row for row in page.splitlines() if row.startswith("| {py:")}
    for name in ads.__all__:
        if name != "__version__" and callable(getattr(ads, name)):
            assert any(key.startswith((f"{name} <", f"{name}.")) for key in rows), name
    written = rows["write <adaptsize.write>"]
    assert "| `path`, `obj`, `*`, `fields=None`, `file_format=None` |" in written
    assert rows["SimplexMesh.boundary <adaptsize.SimplexMesh.boundary>"].split("|")[2].strip() == ""
    located = rows["CartesianGrid.around <adaptsize.CartesianGrid.around>"]
    assert "| `points`, `spacing`, `margin=0.0` |" in located


def test_every_name_in_the_reference_exists():
    text = (DOCS / "api.rst").read_text(encoding="utf-8")
    for name in re.findall(r"^   ([A-Za-z_.]+)$", text, re.MULTILINE):
        *modules, last = name.split(".")
        module = importlib.import_module(".".join(["adaptsize", *modules]))
        assert getattr(module, last).__doc__, name


def test_every_example_is_in_the_gallery_with_its_pictures(extension):
    examples = extension.read_examples(ROOT / "examples")
    assert [e.path.name for e in examples if e.name not in extension.index_of(examples)] == []
    assert len(examples) == len(list((ROOT / "examples").glob("[!_]*.py")))
    assert extension.missing_pictures(examples, DOCS / "figures") == []


def test_a_missing_picture_is_reported(extension, tmp_path):
    script = tmp_path / "plot_new.py"
    script.write_text('"""New."""\n\ndef main(output_dir):\n    save(output_dir / "new.png")\n')
    example = extension.read_example(script)
    assert example.pictures == ("new.png",)
    (line,) = extension.missing_pictures([example], tmp_path)
    assert "plot_new.py" in line
    assert "new.png" in line
    (tmp_path / "new.png").touch()
    assert extension.missing_pictures([example], tmp_path) == []


def test_every_figure_of_the_paper_is_answered(extension):
    examples = extension.read_examples(ROOT / "examples")
    answered = {number for e in examples for number in e.figures} | set(extension.ELSEWHERE)
    assert answered == set(extension.FIGURES)


def test_pictures_are_small():
    large = {p.name: p.stat().st_size for p in DOCS.glob("figures/*") if p.stat().st_size > 200_000}
    assert large == {}


def test_every_decision_is_listed():
    text = (DOCS / "decisions" / "README.md").read_text(encoding="utf-8")
    names = [p.name for p in DOCS.glob("decisions/0*.md")]
    assert [name for name in names if f"]({name})" not in text] == []
