"""What the pages say is so: their code prints what they show, and nothing is left out of the site.

Code runs in a folder whose ``data`` are coarser files of the same names; where that does not make
it quick, COARSER lists what is replaced.  With ADAPTSIZE_PAGES=full in the environment (``make
pages``) it runs word for word instead.  Links, references and formulas are checked by Sphinx, in
.ci/run.
"""

import importlib
import importlib.util
import inspect
import json
import os
import re
import shutil
import sys
import typing
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from coarser_pages import COARSER, FIRST, OF_THE_MACHINE, OTHER_FIGURES
from meshes import jittered_cube
from page_code import Block, blocks_of, matches

import adaptsize as ads
from adaptsize.remeshing import available_backends

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
FULL = os.environ.get("ADAPTSIZE_PAGES") == "full"
METHODS = [
    "adaptation", "adaptive-loops", "anisotropic", "anisotropic-meshes", "complete-size",
    "cost", "distance", "exact-limiting", "files", "limiting", "mesh-families", "octrees",
    "remeshing", "sizes", "smoothing", "sparse-sizes", "width",
]  # fmt: skip
PAGES = [
    "README.md",
    "docs/index.md",
    "docs/install.md",
    *sorted(f"docs/how-to/{p.name}" for p in DOCS.glob("how-to/[a-z]*.md") if p.stem != "dolfinx"),
    *sorted(f"docs/tutorials/{p.name}" for p in DOCS.glob("tutorials/[a-z]*.md")),
    *(f"docs/{name}.md" for name in METHODS),
]


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
    for name in (
        "bracket.stl", "slit.vtu", "block.vtu", "lshape.vtu", "curved.vtu", "plate.vtk",
        "coast.geojson",
    ):  # fmt: skip
        shutil.copy(ROOT / "data" / name, folder)
    corners = np.array([[x, y, z] for x in (0, 20) for y in (0, 12) for z in (0, 8)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    halves = [[a, b, c] for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]
    ads.write(folder / "cube.vtu", jittered_cube(3, 20261122))
    ads.write(folder / "box.stl", ads.SimplexMesh(corners, halves))
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
    """Change to a folder with coarse data, or with the data itself."""
    data = ROOT / "data" if FULL else coarse_data
    (tmp_path / "data").symlink_to(data, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def solve(points, cells):
    """A field and an indicator, in the place of a solver."""
    u = np.hypot(*points.T) ** (2.0 / 3.0)
    return u, ads.zz_indicator(ads.SimplexMesh(points, cells), u)


SCRIPTS = sorted(p.name for p in (ROOT / "examples").glob("[!_]*.py"))


@pytest.mark.timeout(900)  # as below
@pytest.mark.skipif(not available_backends()["mmg"].installed, reason="the pages use Mmg")
@pytest.mark.parametrize("script", SCRIPTS)
def test_the_essential_lines_of_an_example_run(script, extension, workplace):
    pytest.importorskip("pyvista", reason="most of them draw")
    code = extension.read_example(ROOT / "examples" / script).code
    for asked, other in () if FULL else COARSER.get(f"examples/{script}", ()):
        assert asked in code, f"{script} has no {asked!r} any more"
        code = code.replace(asked, other)
    code = code if FULL else code.replace(", path=", ", width=160, path=")
    Block("python", code, 0, None, None).run(script, {"__name__": "page"})
    pictures = re.findall(r'path="(.*?)"', code)
    assert pictures or "print(" in code
    assert all(Path(name).stat().st_size > 500 for name in pictures)


@pytest.mark.timeout(900)  # fTetWild, and kernels to be compiled, on a busy machine
@pytest.mark.skipif(not available_backends()["mmg"].installed, reason="the pages use Mmg")
@pytest.mark.parametrize("page", PAGES)
def test_the_code_of_a_page_prints_what_the_page_shows(page, workplace):
    pytest.importorskip("pyvista", reason="some commands draw")
    text = (ROOT / page).read_text(encoding="utf-8")
    for replacements in (OF_THE_MACHINE, {} if FULL else COARSER):
        for asked, other in replacements.get(page, ()):
            assert asked in text, f"{page} has no {asked!r} any more"
            text = text.replace(asked, other)
    names = {"__name__": "page", "solve": solve}
    blocks = blocks_of(text)
    assert blocks, page
    runs = [block for block in blocks if block.can_run()]
    any_number = not FULL and page in OTHER_FIGURES
    wrong = [block.difference(block.run(ROOT / page, names), any_number) for block in runs]
    assert not any(wrong), page + ": " + "\n\n".join(filter(None, wrong))
    # Also where the other blocks have passed: .ci/run repeats what is skipped, with more packages.
    missing = sorted({block.needs for block in blocks if block not in runs})
    if missing:
        pytest.skip(f"{len(blocks) - len(runs)} of {len(blocks)} blocks need {', '.join(missing)}")


@pytest.mark.parametrize("page", [p for p in PAGES if "tutorials/" in p])
def test_a_notebook_has_the_code_and_the_output_of_its_tutorial(page, monkeypatch):
    monkeypatch.syspath_prepend(DOCS / "_ext")
    text = (ROOT / page).read_text(encoding="utf-8")
    notebook = json.loads(importlib.import_module("notebooks").notebook_of(text))
    cells = [c for c in notebook["cells"] if c["cell_type"] == "code"]
    found = [("".join(o["text"] for o in c["outputs"]), c["source"]) for c in cells]
    blocks = blocks_of(text)
    assert [output for output, _ in found] == [b.output or "" for b in blocks]
    assert [code.replace("!adaptsize", "adaptsize") for _, code in found] == [
        b.code.rstrip("\n") for b in blocks
    ]


def test_the_first_block_of_the_readme_is_the_main_job_and_what_ci_runs():
    first = blocks_of((ROOT / "README.md").read_text(encoding="utf-8"))[0]
    assert first.kind == "sh"
    assert first.code.splitlines() == [
        f'pip install ".[mmg]" && {FIRST}',
        'pip install -e ".[test,mmg,docs]" && python -m pytest -n 2 --dist loadfile',
    ]
    assert first.output  # of the first line; `make pages` compares it


LISTED = """\
...
834 triangles, angle 8.10 deg, 96.75% in the band
  ... written
...
changed by 1.1e-16
time  2.5 s
"""
PRINTED = """\
adaptsize: sizes
841 triangles,  angle 8.11 deg, 97.1% in the band

  a.vtu written
1
2
changed by 0.0e+00
time  31 s: reading 3 s
"""


def test_output_of_another_machine_is_that_of_the_page():
    assert matches(LISTED, PRINTED)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("834", "1034"),
        ("8.10", "9.20"),
        ("96.75%", "86.75%"),
        ("triangles", "tetrahedra"),
        (" written", " read"),
        ("1.1e-16", "1.1e-6"),
        ("...\nchanged", "changed"),
        ("...\n834", "834"),
        ("time", "spent"),
        ("time  2.5 s\n", ""),
        ("changed", "...\nadaptsize: sizes\n...\nchanged"),
    ],
)
def test_wrong_output_on_a_page_is_found(right, wrong):
    assert right in LISTED
    assert not matches(LISTED.replace(right, wrong), PRINTED)


REFERENCE = re.findall(
    r"^   ([A-Za-z_.]+)$", (DOCS / "api.rst").read_text(encoding="utf-8"), re.MULTILINE
)


def test_every_public_name_is_in_the_reference_and_every_name_there_exists():
    assert set(ads.__all__) - {"__version__"} <= set(REFERENCE)
    assert len(REFERENCE) <= 110
    for name in REFERENCE:
        *modules, last = name.split(".")
        module = importlib.import_module(".".join(["adaptsize", *modules]))
        assert getattr(module, last).__doc__, name


@pytest.mark.parametrize("module", ads._SUBMODULES)
def test_every_public_name_of_a_submodule_is_in_the_reference(module):
    home = getattr(ads, module)
    own = [name for name, value in vars(home).items() if inspect.isclass(value)]
    names = getattr(home, "__all__", own)
    # Aliases of types are explained where they are used.
    public = [n for n in names if inspect.isclass(getattr(home, n)) or callable(getattr(home, n))]
    public = [n for n in public if typing.get_origin(getattr(home, n)) is None]
    assert public
    # Some are in several modules, and listed as members of one.
    found = {id(attrgetter(name)(ads)) for name in REFERENCE}
    assert [n for n in public if id(getattr(home, n)) not in found] == []


def test_every_example_is_in_the_gallery_with_its_pictures(extension):
    examples = extension.read_examples(ROOT / "examples")
    assert [e.path.name for e in examples if e.name not in extension.index_of(examples)] == []
    assert len(examples) == len(list((ROOT / "examples").glob("[!_]*.py")))
    assert extension.missing_pictures(examples, DOCS / "figures") == []


def test_every_figure_of_the_paper_is_answered(extension):
    examples = extension.read_examples(ROOT / "examples")
    answered = {number for e in examples for number in e.figures} | set(extension.ELSEWHERE)
    assert answered == set(extension.FIGURES)


def test_pictures_are_small_and_scenes_too(extension):
    """Scenes are loaded only by readers who open them."""
    most = {p: 300_000 if p.name.endswith(extension.SCENES) else 200_000 for p in _figures()}
    assert [p.name for p, size in most.items() if p.stat().st_size > size] == []


def test_six_examples_have_scenes_and_each_has_its_example(extension):
    examples = extension.read_examples(ROOT / "examples")
    written = {name for example in examples for name in example.scenes}
    assert written == {p.name for p in _figures() if p.name.endswith(extension.SCENES)}
    assert len(written) == 6
    (page,) = (extension.page_of(e) for e in examples if e.name == "plot_cost")
    assert 'src="../_static/scenes/cost.html" loading="lazy" title="What each face' in page


def _figures():
    return [*DOCS.glob("figures/*")]


def test_the_animation_plays_once_and_has_a_picture_without_motion():
    image = pytest.importorskip("PIL.Image", reason="opens a picture")
    with image.open(DOCS / "_static" / "growth.webp") as growth:
        assert growth.n_frames > 20
        assert growth.info["loop"] == 1
    assert (DOCS / "_static" / "growth.webp").stat().st_size < 300_000
    page = (DOCS / "size-functions.md").read_text(encoding="utf-8")
    still = '<source media="(prefers-reduced-motion: reduce)" srcset="_static/growth.png">'
    assert still in page
    assert (DOCS / "_static" / "growth.png").is_file()


def test_every_decision_is_listed():
    text = (DOCS / "decisions" / "README.md").read_text(encoding="utf-8")
    names = [p.name for p in DOCS.glob("decisions/0*.md")]
    assert [name for name in names if f"]({name})" not in text] == []
