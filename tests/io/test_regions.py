"""`polygons` with ``box`` and ``least_width``: the sea around land, without narrow parts."""

import json
import warnings

import numpy as np
import pytest
import shapely
from command_line import call
from hypothesis import given, settings
from hypothesis import strategies as st

import adaptsize as ads
from adaptsize import polygons, read
from adaptsize.errors import InputWarning

SQUARE = np.array([(0, 0), (10, 0), (10, 10), (0, 10)], float)


def disc(n, middle, radius):
    angle = 2 * np.pi * np.arange(n) / n
    return np.add(middle, radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def region_of(mesh):
    return shapely.union_all(shapely.polygons(mesh.points[mesh.cells]))


def lengths(mesh):
    """The length of the boundary of each name."""
    ends = mesh.points[mesh.tagged_facets]
    own = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    return {name: own[mesh.facet_tags == tag].sum() for (_, tag), name in mesh.tag_names.items()}


# --- box ------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_the_sea_is_the_box_without_the_land_and_its_sides_have_names(seed):
    rng = np.random.default_rng(seed)
    land = [disc(rng.integers(5, 40), rng.uniform(0, 10, 2), rng.uniform(0.3, 4)) for _ in "ab"]
    lake = disc(12, land[0].mean(axis=0), 0.15)
    a, b = map(shapely.Polygon, land)
    if a.intersects(b):
        land = land[:1]
    mesh = polygons([*land, lake], box=(0, 0, 10, 10))
    whole = shapely.difference(
        shapely.union_all([shapely.Polygon(ring) for ring in land]), shapely.Polygon(lake)
    )
    sea = shapely.difference(shapely.box(0, 0, 10, 10), whole)
    assert mesh.measures.sum() == pytest.approx(sea.area, rel=1e-9)
    found = lengths(mesh)
    for name, side in zip(("south", "east", "north", "west"), range(4), strict=True):
        line = shapely.LineString(SQUARE[[side, (side + 1) % 4]])
        assert found.get(name, 0.0) == pytest.approx(shapely.difference(line, whole).length)
    assert found["land"] == pytest.approx(sea.length - sum(found.values()) + found["land"])


def test_the_names_of_land_are_kept_and_a_box_of_land_only_is_refused(tmp_path):
    pytest.importorskip("mmgpy")
    coast = [(-3, -3), (12, -3), (12, 2), (6, 4), (-3, 2)]
    mesh = polygons({"mainland": coast}, islands={"rock": disc(20, (5, 8), 1)}, box=(0, 0, 10, 10))
    assert set(lengths(mesh)) == {"mainland", "rock", "east", "north", "west"}
    for box in ((0, -2, 1, -1), (4.9, 7.9, 5.1, 8.1)):
        with pytest.raises(ValueError, match="box must have a part outside of land"):
            polygons({"mainland": coast}, islands={"rock": disc(20, (5, 8), 1)}, box=box)
    for box in ((0, 0, 0, 1), (1, 1, 0, 2), (0, 1, 2)):
        with pytest.raises(ValueError, match="box must"):
            polygons(coast, box=box)
    feature = {"type": "Polygon", "coordinates": [[*map(list, coast), [-3, -3]]]}
    (tmp_path / "land.geojson").write_text(json.dumps({"crs": "utm", **feature}))
    words = ["--box", "0,0,10,10", "--hmax", "1", "-o", tmp_path / "sea.vtu"]
    assert call("remesh", tmp_path / "land.geojson", *words) == 0
    assert set(read(tmp_path / "sea.vtu").tag_names.values()) == {"land", "east", "north", "west"}


# --- least width ----------------------------------------------------------------------------------


def moved(points, rng):
    turn = np.linalg.qr(rng.standard_normal((2, 2)))[0]
    scale, shift = 10.0 ** rng.uniform(-2, 5), rng.standard_normal(2)
    return scale, [scale * (np.asarray(p, float) @ turn + shift) for p in points]


def channel(width):
    """Two basins with a channel of a width between them."""
    a, b = 5 - width / 2, 5 + width / 2
    return [(0, 0), (4, 0), (4, a), (6, a), (6, 0), (10, 0), (10, 10), (6, 10), (6, b), (4, b),
            (4, 10), (0, 10)]  # fmt: skip


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.05, 0.3, 0.7]))
def test_narrow_water_and_land_go_and_wide_ones_stay(seed, width):
    rng = np.random.default_rng(seed)
    scale, (outer,) = moved([channel(width)], rng)
    with pytest.warns(InputWarning, match=r"1 part of the domain left out, narrower than"):
        mesh = polygons(outer, least_width=scale)
    assert mesh.measures.sum() == pytest.approx(80 * scale**2, rel=0.01)
    assert len(shapely.get_parts(region_of(mesh))) == 2
    same = polygons(outer, least_width=0.9 * width * scale)  # nothing is narrower: no warning
    assert same.measures.sum() == pytest.approx((80 + 2 * width) * scale**2, rel=1e-9)
    # The same as land: a spit from the shore, and a rock.
    spit = [(0, 0), (10, 0), (10, 10), (5, 10), (5, 4), (5 - width, 4), (5 - width, 10), (0, 10)]
    scale, (outer, rock) = moved([spit, disc(20, (2, 2), 0.4)], rng)
    with pytest.warns(InputWarning, match=r"2 parts of land or holes filled, narrower than"):
        mesh = polygons(outer, holes={"rock": rock}, least_width=scale)
    assert mesh.measures.sum() == pytest.approx(100 * scale**2, rel=0.01)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_no_part_is_narrower_and_the_rest_of_the_boundary_stays(seed):
    rng, width = np.random.default_rng(seed), 0.5
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    radius = 4.0 * rng.uniform(0.5, 1.0, 60)
    outer = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    with pytest.warns(InputWarning, match="narrower than 0.5"):
        mesh = polygons({"shore": outer}, least_width=width)
    assert mesh.signed_measures.min() > 0.0
    assert set(mesh.tag_names.values()) == {"shore"}
    assert len(mesh.tagged_facets) == len(mesh.boundary().mesh.cells)
    found, given_ = region_of(mesh), shapely.Polygon(outer)
    # Discs of less than the width, since lines are simplified, fit everywhere but into corners.
    for region in (found, shapely.difference(shapely.box(-9, -9, 9, 9), found)):
        opened = shapely.buffer(shapely.buffer(region, -0.25 * width), 0.26 * width)
        rest = shapely.get_parts(shapely.difference(region, opened))
        assert max(shapely.area(rest), default=0.0) < 0.25 * width**2
    wide = shapely.buffer(shapely.buffer(given_, -width), width)
    assert shapely.difference(wide, found).area < 0.02 * wide.area
    assert shapely.hausdorff_distance(found, given_) < 4.0


def test_edges_are_not_much_shorter_than_the_least_width(tmp_path):
    pytest.importorskip("mmgpy")
    rng = np.random.default_rng(71)
    x = np.linspace(0, 10, 400)
    shore = np.column_stack([x, 3 + np.sin(x) + 0.05 * rng.standard_normal(400)])
    lines = {"land": shore, "open": [shore[-1], (10, 10), (0, 10), shore[0]]}
    edges = {}
    for width in (0.0, 0.5):
        with warnings.catch_warnings():  # of narrow parts, and of details that stay
            warnings.simplefilter("ignore")
            domain = polygons(lines, least_width=width)
            mesh = ads.remesh(domain, ads.size_function(domain, hmin=0.5, hmax=2.0))
        edges[width] = mesh.boundary().mesh.measures
        assert set(lengths(mesh)) == {"land", "open"}
    assert edges[0.0].min() < 0.05
    assert (edges[0.0] < 0.25).mean() > 0.3
    assert (edges[0.5] < 0.25).mean() < 0.1


def test_a_width_that_leaves_nothing_is_refused_and_other_files_have_none(tmp_path, capsys):
    with pytest.raises(ValueError, match="least_width must be smaller: no part is as wide as 12"):
        polygons(SQUARE, least_width=12)
    ads.write(tmp_path / "a.vtu", polygons(SQUARE))
    assert call("info", tmp_path / "a.vtu", "--least-width", "1") != 0
    message = capsys.readouterr().err
    assert "--least-width applies to files of polygons, got" in message


def test_details_that_are_kept_are_a_warning_with_places(tmp_path, capsys):
    pytest.importorskip("mmgpy")
    teeth = [(k / 50, 10 + 0.05 * (k % 2)) for k in range(500, -1, -1)]
    domain = polygons([(0, 0), (10, 0), *teeth])
    with pytest.warns(ads.errors.ResolutionWarning, match="shorter than an eighth") as caught:
        ads.remesh(domain, 0.5)
    text = next(str(one.message) for one in caught if "eighth" in str(one.message))
    place = [float(x) for x in text.split("worst at (")[1].split(")")[0].split(",")]
    assert 9.9 < place[1] < 10.1
    ads.remesh(domain, 0.05)  # no warning: the size has the details
    rows = [*map(list, [(0, 0), (10, 0), *teeth, (0, 0)])]
    feature = {"crs": "utm", "type": "Polygon", "coordinates": [rows]}
    (tmp_path / "a.geojson").write_text(json.dumps(feature))
    words = ["--hmin", "0.5", "--hmax", "0.5", "--tolerance", "1e-4", "-o", tmp_path / "a.vtu"]
    call("remesh", tmp_path / "a.geojson", *words)
    assert "edges of the boundary are shorter than an eighth" in capsys.readouterr().err
    words += ["--least-width", "0.5"]
    call("remesh", tmp_path / "a.geojson", *words)
    assert "shorter than an eighth" not in capsys.readouterr().err
