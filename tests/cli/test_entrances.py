"""What each entrance implements: its help, its refusals, and the same results by all entrances."""

import numpy as np
import pytest
import typer
from command_line import call

import adaptsize as ads
from adaptsize.cli.commands import app
from adaptsize.errors import InputWarning
from adaptsize.options import SizeFunctionOptions, options_of
from adaptsize.options.entrances import DOMAINS, ENTRANCES

COMMANDS = typer.main.get_command(app).commands
#: The function behind each command that makes sizes or meshes.
FUNCTIONS = {"size": "size_function", "image": "mesh_image", "family": "mesh_family"}
X, Y = np.mgrid[-9:10, -9:10]
DISC = np.hypot(X, Y) < 7


def disc(points):
    return np.linalg.norm(points, axis=1) - 1.0


#: A domain of each kind, with the further arguments, and a value of each option.
GIVEN = {
    "meshes": (ads.SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], cell_tags=[1]), {}),
    "implicit functions": (disc, {"box": ([-1.1, -1.1], [1.1, 1.1])}),
    "images": (DISC, {}),
}
VALUES = {
    "elements_per_radian": 3.0, "elements_across": 1.0, "elements_between": 1.0, "g": 0.3,
    "growth": 1.3, "hmin": 0.1, "hmax": 0.5, "crease_angle": 50.0, "tolerance": 0.01,
    "size_of": {"region 1": 0.3}, "elements": 60.0, "nodes": 60.0, "dofs": 40.0,
    "max_elements": 900.0, "max_memory": "1GB", "degree": 2, "components": 2, "spacing": 0.1,
    "label": 1, "threshold": 0.5, "smoothing": 1.0,
}  # fmt: skip


@pytest.mark.parametrize("kind", DOMAINS)
def test_each_option_works_for_the_domains_that_list_it_and_is_refused_for_others(kind):
    domain, more = GIVEN[kind]
    for name in options_of(SizeFunctionOptions):
        given = {**more, name: VALUES[name]}
        if name in options_of(DOMAINS[kind]):
            assert ads.size_function(domain, **given).report is not None
        else:
            with pytest.raises(ValueError, match=f"^{name} applies to .*, got it with "):
                ads.size_function(domain, **given)


def test_options_that_disable_a_bound_may_be_given_where_there_is_none():
    box = ([-1.1, -1.1], [1.1, 1.1])
    ads.size_function(disc, box=box, elements_between=0, tolerance=np.inf)


def test_a_box_is_refused_where_it_has_no_effect():
    with pytest.raises(ValueError, match=r"^box applies to functions without a background"):
        ads.size_function(GIVEN["meshes"][0], box=([0, 0], [1, 1]))


def test_the_table_has_the_options_of_the_functions():
    for name, record in ENTRANCES.items():
        assert getattr(ads, name).__options__ is record


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_command_offers_all_options_of_its_function_and_no_others(name):
    offered = {parameter.name for parameter in COMMANDS[name].params}
    every = {option for record in ENTRANCES.values() for option in options_of(record)}
    # The order is that of elements in files.
    assert offered & every - {"order"} == {*options_of(ENTRANCES[FUNCTIONS[name]])}


def test_an_option_of_other_functions_is_refused_with_these():
    with pytest.raises(TypeError, match=r"'spacing': it is of size_function and mesh_image$"):
        ads.remesh(GIVEN["meshes"][0], 0.3, spacing=1)
    with pytest.raises(TypeError, match=r"'elements': it is of .*remesh_to_elements"):
        ads.remesh(GIVEN["meshes"][0], 0.3, elements=10)


def test_an_angle_in_radians_causes_one_warning():
    with pytest.warns(InputWarning, match="crease_angle is in degrees, got 0.7") as seen:
        ads.size_function(GIVEN["meshes"][0], crease_angle=0.7)
    assert len(seen) == 1


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("image none.npy -o o.vtu --elements-between 1", "it is of family, remesh and size"),
        ("image none.npy -o o.vtu --close-holes", "it is of remesh"),
        ("check none.vtu --hmax=3", "--hmax: it is of adapt, family, image, remesh and size"),
        ("check none.vtu -K 3", "-K: it is of family, image, remesh and size"),
        ("size none.npy -o o.vti --elements-between 1", "--elements-between applies to meshes, "),
        ("size none.npy -o o.vti --keep-slits", "--keep-slits applies to meshes, got it with"),
        ("size none.vtu -o o.vtu --spacing 1", "--spacing applies to images, got it with none"),
        ("image none.npy -o o.vtu --options o.toml", "'strict': it is of family and remesh"),
    ],
)
def test_an_option_of_other_commands_is_refused_before_reading(
    capsys, monkeypatch, tmp_path, line, expected
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "o.toml").write_text("strict = true")
    assert call(*line.split()) == 2
    assert expected in " ".join(capsys.readouterr().err.split())


def random_options(seed):
    """Return random options of sizes, few enough for parameters to be chosen from the part."""
    rng = np.random.default_rng(seed)
    drawn = {
        "elements_per_radian": float(rng.integers(0, 5)),
        "elements_across": rng.choice([0.0, 0.5, 1.5]),
        "elements_between": rng.choice([0.0, 1.0]),
        "g": round(rng.uniform(0.1, 0.6), 3),
        "growth": round(rng.uniform(1.1, 1.6), 3),
        "hmin": round(rng.uniform(0.02, 0.08), 4),
        "hmax": round(rng.uniform(0.15, 0.4), 4),
        "crease_angle": round(rng.uniform(20.0, 60.0), 2),
        "tolerance": rng.choice([1e-3, 1e-2]),
        "max_elements": 150.0,
    }
    names = [name for name in drawn if rng.random() < 0.4]
    if "g" in names and "growth" in names:
        names.remove("growth")
    return {name: float(drawn[name]) for name in names} | ({} if "hmax" in names else {"hmax": 0.3})


@pytest.fixture(scope="module")
def corner(tmp_path_factory):
    """A file with a plate in the shape of an L, with a notch."""
    outline = [[0, 0], [1, 0], [1, 0.4], [0.5, 0.4], [0.45, 0.3], [0.4, 0.4], [0.4, 1], [0, 1]]
    cells = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [0, 4, 5], [0, 5, 7], [5, 6, 7]]
    path = tmp_path_factory.mktemp("plate") / "plate.vtu"
    ads.write(path, ads.SimplexMesh(outline, cells))
    return path


@pytest.mark.parametrize("seed", range(18))
def test_the_command_the_function_and_the_accessor_make_the_same(corner, tmp_path, seed):
    """The sizes by random options; of each third one also the mesh."""
    pyvista = pytest.importorskip("pyvista", reason="one of the entrances is PyVista's")
    options = random_options(seed)
    words = [w for name, v in options.items() for w in (f"--{name.replace('_', '-')}", v)]
    mesh, data_set = ads.read(corner), pyvista.read(corner)
    size = ads.size_function(mesh, **options)
    sized = data_set.adaptsize.size(**options)
    assert call("size", corner, "-o", tmp_path / "h.vtu", "-q", *words) == 0
    np.testing.assert_array_equal(ads.read(tmp_path / "h.vtu").point_data["h"], size.values)
    np.testing.assert_array_equal(sized.adaptsize.size_function.values, size.values)
    if seed % 3:
        return
    tolerance = options.get("tolerance", 1e-3)
    new = ads.remesh(mesh, size, tolerance=tolerance, g=size.report.g)
    by_accessor = sized.adaptsize.remesh(tolerance=tolerance, g=size.report.g).adaptsize.mesh
    call("remesh", corner, "-o", tmp_path / "new.vtu", "-q", *words)
    for other in (by_accessor, ads.read(tmp_path / "new.vtu")):
        np.testing.assert_array_equal(other.cells, new.cells)
        np.testing.assert_array_equal(other.points[:, :2], new.points)


def test_the_command_and_the_function_make_the_same_mesh_of_an_image(tmp_path):
    np.save(tmp_path / "disc.npy", DISC)
    words = ["--spacing", "0.1", "--elements", "70", "--seed", "7", "--smoothing", "1"]
    assert call("image", tmp_path / "disc.npy", "-o", tmp_path / "o.vtu", *words) in (0, 1)
    image = ads.io.read_image(tmp_path / "disc.npy")
    mesh = ads.mesh_image(image, spacing=0.1, elements=70, seed=7, smoothing=1)
    np.testing.assert_array_equal(ads.read(tmp_path / "o.vtu").cells, mesh.cells)
