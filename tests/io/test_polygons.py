"""`polygons`: the domain between lines, from arrays and from files, with the names of its parts."""

import json
import re

import numpy as np
import pytest
import shapefile
import shapely
from command_line import call
from hypothesis import given
from hypothesis import strategies as st

import adaptsize as ads
from adaptsize import polygons, read
from adaptsize.errors import InputWarning, MeshFileError

SQUARE = np.array([(0, 0), (4, 0), (4, 4), (0, 4)], float)
TRIANGLE = np.array([(1, 1), (2, 1), (2, 2)], float)
SHORE, SEA = [(0, 0), (2, 1), (4, 0)], [(4, 0), (4, -3), (0, -3), (0, 0)]


def star(n, seed, middle=(0.0, 0.0), radius=1.0):
    """A ring that does not cross itself."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, n))
    distance = radius * rng.uniform(0.5, 1.0, n)
    return np.add(middle, distance[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def area(ring):
    x, y = np.transpose(ring)
    return 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def named_lengths(mesh):
    """The length of the boundary of each name."""
    ends = mesh.points[mesh.tagged_facets]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    return {
        name: lengths[mesh.facet_tags == tag].sum() for (_, tag), name in mesh.tag_names.items()
    }


def boundary_lines(mesh):
    """The boundary as a set of points and lines of shapely."""
    boundary = mesh.boundary().mesh
    return shapely.union_all(shapely.linestrings(boundary.points[boundary.cells]))


# --- the domain -----------------------------------------------------------------------------------


def disc(n, middle, radius=1.0, turn=0.0):
    angle = turn + 2 * np.pi * np.arange(n) / n
    return np.add(middle, radius * np.column_stack([np.cos(angle), np.sin(angle)]))


CONTACTS = {
    "two holes": lambda gap: [disc(24, (-1 - gap, 0)), disc(36, (1, 0), turn=np.pi)],
    "a hole at a wall": lambda gap: [disc(24, (3 - gap, 0.4))],
    "an island in a lake": lambda gap: [disc(40, (0, 0), 2.0), disc(20, (1 - gap, 0))],
    "a notch across a ring": lambda gap: [
        [(-2, -2), (0, -2), (0, -gap), (0.5, -1), (2, -1), (2, 1), (0, 0), (-2, 1)]
    ],
    "a spike": lambda gap: [[(-1, -1), (1, -1), (1, 0), (2, gap), (1, 2 * gap), (1, 1), (-1, 1)]],
}


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([*CONTACTS]),
    st.sampled_from([0.0, 1e-17, 1e-16, 1e-13, 1e-10, 2e-9]),
)
def test_contact_closer_than_rounding_is_refused_with_its_place(seed, kind, gap):
    rng = np.random.default_rng(seed)
    outer = np.array([(-4, -4), (4, -4), (4, 4), (-4, 4)])
    rings = CONTACTS[kind](gap)
    touches = (4.0, 0.4) if "wall" in kind else (2, 0) if "lake" in kind else (0, 0)
    touches = np.array((1.5, gap) if kind == "a spike" else touches)
    turn = np.linalg.qr(rng.standard_normal((2, 2)))[0]
    scale, shift = 10.0 ** rng.uniform(-3, 6), rng.standard_normal(2)

    def moved(points):
        return scale * (np.asarray(points, float) @ turn + shift)

    with pytest.raises(ValueError, match=r"touch|crosses|3 different") as caught:
        polygons(moved(outer), holes=[moved(ring) for ring in rings])
    place = re.search(r"(?:at|near|between) \((.*?), (.*?)\)", str(caught.value))
    away = np.subtract([float(x) for x in place.groups()], moved(touches[None])[0])
    assert np.linalg.norm(away) <= (0.6 if kind == "a spike" else 1e-4) * scale


@given(st.integers(0, 2**32 - 1), st.sampled_from([*CONTACTS]), st.sampled_from([1e-7, 1e-5, 1e-3]))
def test_small_gaps_are_kept_with_cells_that_have_an_area(seed, kind, gap):
    rng = np.random.default_rng(seed)
    outer = np.array([(-4, -4), (4, -4), (4, 4), (-4, 4)])
    rings = [np.array(ring, float) for ring in CONTACTS[kind](gap)]
    turn = np.linalg.qr(rng.standard_normal((2, 2)))[0]
    mesh = polygons(outer @ turn, holes=[ring @ turn for ring in rings])
    holes = [area(ring) for ring in rings]
    wanted = 64.0 - holes[0] + sum(holes[1:]) * (1 if "lake" in kind else -1)
    assert mesh.measures.sum() == pytest.approx(wanted, rel=1e-12)
    assert mesh.signed_measures.min() > 0.0


@pytest.mark.parametrize("seed", range(5))
def test_the_domain_is_what_an_odd_number_of_rings_contains(seed):
    outer, hole = star(40, seed), star(30, seed + 50, radius=0.3)
    inner, apart = star(9, seed + 90, radius=0.1), star(5, seed, (4.0, 1.0))
    mesh = polygons([inner, outer, apart], holes=[hole])
    assert mesh.signed_measures.min() > 0.0
    wanted = area(outer) - area(hole) + area(inner) + area(apart)
    assert mesh.measures.sum() == pytest.approx(wanted, rel=1e-12)
    rings = shapely.union_all([shapely.LinearRing(r) for r in (outer, hole, inner, apart)])
    assert shapely.hausdorff_distance(boundary_lines(mesh), rings) < 1e-14
    assert {tuple(p) for p in outer.tolist()} <= {tuple(p) for p in mesh.points.tolist()}


MOVES = {
    "turned": np.array([[0.6, -0.8], [0.8, 0.6]]),
    "mirrored": np.array([[-1.0, 0.0], [0.0, 1.0]]),
}


@pytest.mark.parametrize("move", [*MOVES, "shifted", "reversed", "reordered"])
def test_the_same_lines_give_the_same_domain(move):
    shore = np.column_stack([np.linspace(-2, 2, 30), 1.2 + 0.1 * np.sin(np.arange(30.0))])
    sea = np.array([shore[-1], (2, -2), (-2, -2), shore[0]])
    holes = [star(20, 3, (-1.0, 0.0), 0.5), star(11, 4, (1.0, 0.0), 0.7)]
    first = polygons({"land": shore, "open sea": sea}, holes={"island": holes}, tolerance=1e-3)

    def moved(points):
        points = np.asarray(points) @ MOVES.get(move, np.eye(2)).T
        return np.add(points, (1e3, -7.0)) if move == "shifted" else points

    lines = [moved(line) for line in (shore, sea)]
    rings = [moved(ring) for ring in holes]
    if move == "reversed":
        lines, rings = [line[::-1] for line in lines], [ring[::-1] for ring in rings]
    outer = {"land": lines[0], "open sea": lines[1]}
    if move == "reordered":
        outer = dict(reversed(outer.items()))
        rings = [np.roll(ring, 4, axis=0) for ring in rings[::-1]]
    second = polygons(outer, holes={"island": rings}, tolerance=1e-3)
    assert second.measures.sum() == pytest.approx(first.measures.sum(), rel=1e-9)
    lengths = named_lengths(first)
    assert named_lengths(second) == pytest.approx(lengths, rel=1e-9)
    assert list(second.tag_names.values()) == ["island", "land", "open sea"]
    back = shapely.MultiPoint(moved(first.points[first.tagged_facets].reshape(-1, 2)))
    there = shapely.MultiPoint(second.points[second.tagged_facets].reshape(-1, 2))
    assert shapely.hausdorff_distance(back, there) < 1e-9


def test_names_belong_to_their_parts_of_the_boundary():
    mesh = polygons({"land": SHORE, "open sea": SEA})
    assert named_lengths(mesh) == pytest.approx({"land": 2 * np.sqrt(5), "open sea": 10.0})
    closed = np.vstack([SQUARE, SQUARE[:1]])
    wanted = {"land": 12.0, "inlet": 4.0, "rock": 2.0 + np.sqrt(2.0)}
    for tolerance in (0.0, 0.01):
        outer = {"land": closed, "inlet": SQUARE[1:3]}
        along = polygons(outer, islands={"rock": TRIANGLE}, tolerance=tolerance)
        assert named_lengths(along) == pytest.approx(wanted)


def test_other_objects_give_the_same_domain():
    mesh = polygons(SQUARE, holes=[TRIANGLE])
    with pytest.warns(InputWarning, match="look like longitude and latitude"):
        of_shapely = polygons(shapely.Polygon(SQUARE, [TRIANGLE]))
    np.testing.assert_array_equal(of_shapely.points, mesh.points)
    of_segments = polygons(mesh.boundary().mesh)
    assert of_segments.measures.sum() == pytest.approx(15.5)


def test_lines_are_simplified_within_the_tolerance_and_their_ends_stay():
    x = np.linspace(0.0, 8.0, 4001)
    shore = np.column_stack([x, np.sin(x) + 0.02 * np.sin(100.0 * x)])
    sea = [shore[-1], (8.0, -6.0), (0.0, -6.0), shore[0]]
    rocks = [TRIANGLE - (0.0, 5.0), 0.01 * TRIANGLE + (4.0, -3.0)]
    with pytest.warns(InputWarning, match=r"1 rings in circles of the tolerance, 0\.\d+, left"):
        mesh = polygons({"land": shore, "open": sea}, holes={"rock": rocks}, tolerance=5e-3)
    length = 5e-3 * np.hypot(8.0, 6.0 + shore[:, 1].max())
    facets = mesh.tagged_facets[mesh.facet_tags == 1]
    assert mesh.tag_names[1, 1] == "land"
    line = shapely.union_all(shapely.linestrings(mesh.points[facets]))
    assert shapely.hausdorff_distance(line, shapely.LineString(shore)) <= length
    assert len(facets) < 300
    assert named_lengths(mesh)["open"] == pytest.approx(14.0 + shore[-1, 1] + 6.0, rel=1e-12)
    assert named_lengths(mesh)["rock"] == pytest.approx(2.0 + np.sqrt(2.0))


BAD = {
    "bow-tie": ([SQUARE[[0, 2, 1, 3]]], {}, "outer[0] crosses or touches itself at (2, 2)"),
    "fold": ([(0, 0), (4, 0), (2, 0), (2, 3)], {}, "outer crosses or touches itself at (2, 0)"),
    "line": (SQUARE[:2], {}, "outer must have 3 different points or more, near (0, 0)"),
    "nan": ([(0, 0), (1, np.nan), (1, 1)], {}, "outer must be finite, got outer[1, 1] = nan"),
    "outside": (SQUARE, {"holes": [TRIANGLE + 9]}, "holes[0] is not inside another ring, near (1"),
    "crossing": (
        SQUARE,
        {"holes": [np.add(TRIANGLE, (2.5, 0))]},
        "outer and holes[0] cross or touch at (4",
    ),
    "on an edge": (
        SQUARE,
        {"holes": TRIANGLE - (1, 0)},
        "outer and holes cross or touch at (0, 1)",
    ),
    "on a node": (SQUARE, {"islands": TRIANGLE - 1}, "outer and islands touch at (0, 0)"),
    "twice": ([SQUARE, SQUARE], {}, "outer[0] and outer[1] both run between (0, 0) and (4, 0)"),
    "open": (
        {"land": SHORE, "sea": [*SEA[:-1], (0, 1e-6)]},
        {},
        "outer['land'] is open: it ends at (0, 0), where no other line begins; the nearest open "
        "end is at (0, 1e-06), 1e-06 away",
    ),
    "none": ([], {}, "outer must have at least one polygon, got none"),
    "none, with a width": (
        [],
        {"least_width": 1},
        "outer must have at least one polygon, got none",
    ),
    "number": (3, {}, "outer must be polygons, got 3"),
    "in space": (np.pad(SQUARE, ((0, 0), (0, 1))), {}, "outer must have shape (n, 2), got (4, 3)"),
    "tiny": (1e-70 * SQUARE, {}, "points must have coordinates of 1e-60 to 1e+60 in size"),
    "tiny hole": (
        SQUARE,
        {"holes": 1e-200 * TRIANGLE},
        "holes must have 3 different points or more, near (0, 0)",
    ),
    "name": ({1: SQUARE}, {}, "outer must have names of 1 to 100 letters, got 1"),
    "all small": (SQUARE, {"tolerance": 1}, "tolerance must be smaller: all rings are in circles"),
}


@pytest.mark.parametrize("case", BAD)
def test_lines_that_are_no_rings_are_refused_with_the_place(case):
    outer, others, message = BAD[case]
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        polygons(outer, **others)
    assert "\n" not in str(error.value)


# --- sizes ----------------------------------------------------------------------------------------


def test_sizes_follow_from_the_shape_and_from_sources_far_from_the_boundary():
    pytest.importorskip("mmgpy")
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    hole = (8.0, 5.0) + 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    mesh = polygons([(0, 0), (20, 0), (20, 10), (0, 10)], holes=[hole, np.add(TRIANGLE, (16.9, 6))])
    box = ads.BoxSource((12.0, 3.0), (13.5, 4.5), 0.05)
    size = ads.size_function(mesh, hmin=0.01, hmax=2.0, sources=[box])
    assert size([[12.75, 3.75]]) == pytest.approx(0.05, rel=0.3)
    assert size([[8.5, 5.0]]) == pytest.approx(0.5 / 4.0, rel=0.15)  # 4 elements per radian
    assert size([[19.0, 7.5]])[0] < 0.8  # a gap of 1.1
    assert size([[2.0, 8.0]])[0] > 1.2
    new = ads.remesh(mesh, ads.size_function(mesh, hmin=0.05, hmax=1.0))
    assert new.measures.sum() == pytest.approx(mesh.measures.sum(), rel=1e-3)
    assert new.minimum_angles().min() > 15.0


# --- files ----------------------------------------------------------------------------------------

RINGS = {"wall": np.vstack([SQUARE, SQUARE[:1]]), "rock": np.vstack([TRIANGLE, TRIANGLE[:1]])}


def feature(shape, coordinates, **properties):
    geometry = {"type": shape, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def write_geojson(path, *features):
    collection = {"type": "FeatureCollection", "crs": "EPSG:25832", "features": features}
    path.write_text(json.dumps(collection))


def geojson_polygon(path):
    write_geojson(
        path,
        feature("Polygon", [ring.tolist() for ring in RINGS.values()], name="wall"),
        feature("LineString", RINGS["rock"].tolist(), boundary="rock"),
        feature("Point", [7.0, 7.0]),
    )


def geojson_lines(path):
    write_geojson(
        path,
        feature("MultiLineString", [SQUARE[:3].tolist()], name="wall"),
        feature("LineString", [[0, 0, 5], [0, 4, 5], [4, 4, 5]], NAME="wall"),
        feature("MultiPolygon", [[RINGS["rock"].tolist()]], kind="rock"),
    )


def shapes(path):
    with shapefile.Writer(str(path)) as file:
        file.field("Name", "C")
        file.poly([RINGS["wall"].tolist()])
        file.record("wall")
        file.poly([RINGS["rock"].tolist()])
        file.record("rock")
        file.null()
        file.record("nothing")


def table(path):
    rows = [f"{x};{y};{name}" for name, ring in RINGS.items() for x, y in ring]
    path.write_text("x;y;name\n" + "\n".join(rows) + "\n")


def table_with_spaces(path):
    rows = [f"{x}  {y} {name}" for name, ring in RINGS.items() for x, y in ring]
    path.write_text("# x y name\n" + "\n".join(rows) + "\n")


def wkt_quoted(path):
    """As QGIS writes tables."""
    rows = [
        f'"{shapely.LineString(ring).wkt}",{k},{name}'
        for k, (name, ring) in enumerate(RINGS.items())
    ]
    path.write_text("WKT,id,name\n" + "\n".join(rows) + "\n")


def wkt_bare(path):
    rows = [f"{name};SRID=25832;{shapely.Polygon(r).wkt.lower()}" for name, r in RINGS.items()]
    path.write_text("\n".join([*rows, "buoy;SRID=25832;POINT Z (1 1 1)"]) + "\n")


def wkt_collection(path):
    rings = [shapely.Polygon(ring) for ring in RINGS.values()]
    whole = shapely.GeometryCollection([shapely.MultiPolygon(rings[:1]), rings[1]])
    path.write_text(f"{whole.wkt}\n".replace(" (", "\n("))


def poly(path):
    ends = [(1, 2, "wall"), (2, 3, "wall"), (3, 4, "wall"), (4, 1, "wall")]
    ends += [(5, 6, "rock"), (6, 7, "rock"), (7, 5, "rock")]
    marker = {"wall": 7, "rock": 9}
    nodes = [f"{k} {x} {y}" for k, (x, y) in enumerate(np.vstack([SQUARE, TRIANGLE]), 1)]
    rows = [f"{k} {a} {b} {marker[name]}" for k, (a, b, name) in enumerate(ends, 1)]
    lines = ["# nodes", "7 2 0 0", *nodes, "7 1", *rows, "1  # hole", "1 1.6 1.2"]
    path.write_text("\n".join(lines) + "\n")


FILES = {
    "polygon.geojson": geojson_polygon,
    "lines.json": geojson_lines,
    "a.shp": shapes,
    "a.csv": table,
    "spaces.csv": table_with_spaces,
    "quoted.csv": wkt_quoted,
    "bare.csv": wkt_bare,
    "a.poly": poly,
}


@pytest.mark.filterwarnings("ignore::adaptsize.errors.InputWarning")
@pytest.mark.parametrize("name", FILES)
def test_files_give_the_domain_and_the_names(tmp_path, name):
    FILES[name](tmp_path / name)
    mesh = read(tmp_path / name)
    assert mesh.measures.sum() == pytest.approx(15.5, rel=1e-12)
    lengths = sorted(named_lengths(mesh).values())
    assert lengths == pytest.approx([2.0 + np.sqrt(2.0), 16.0], rel=1e-12)
    wanted = {"7", "9"} if name == "a.poly" else {"wall", "rock"}
    assert set(mesh.tag_names.values()) == wanted
    same = polygons(tmp_path / name)
    np.testing.assert_array_equal(same.points, mesh.points)


@pytest.mark.filterwarnings("ignore::adaptsize.errors.InputWarning")
def test_a_collection_of_geometries_over_several_lines(tmp_path):
    wkt_collection(tmp_path / "a.csv")
    assert read(tmp_path / "a.csv").measures.sum() == pytest.approx(15.5, rel=1e-12)


def test_what_is_left_out_is_reported(tmp_path):
    geojson_polygon(tmp_path / "a.geojson")
    with pytest.warns(InputWarning, match=r"1 points left out, the first in features\[2\]"):
        read(tmp_path / "a.geojson")


def test_degrees_draw_a_warning_unless_the_file_names_other_coordinates(tmp_path):
    data = feature("Polygon", [RINGS["wall"].tolist()])
    (tmp_path / "a.geojson").write_text(json.dumps(data))
    with pytest.warns(InputWarning, match="project them to a plane first"):
        read(tmp_path / "a.geojson")
    shapes(tmp_path / "b.shp")
    (tmp_path / "b.prj").write_text('GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984"]]')
    with pytest.warns(InputWarning, match="project them to a plane first"):
        read(tmp_path / "b.shp")


DAMAGED = {
    "cut.geojson": ('{"type": "Polygon", "coordinates": [[[0, 0],', "Expecting value"),
    "deep.geojson": ("[" * 200_000, "nested too deeply"),
    "kind.geojson": ('{"type": "Circle"}', "the geometry must be a geometry of GeoJSON"),
    "text.geojson": (json.dumps(feature("Polygon", "abc")), "must have a list of coordinates"),
    "flat.geojson": (json.dumps(feature("LineString", [1, 2])), "must have lists of points"),
    "nan.geojson": (json.dumps(feature("LineString", [[0, np.nan]])), "must be finite"),
    "open.geojson": (
        json.dumps(feature("Polygon", [SQUARE.tolist()])),
        "the geometry has an open ring, which begins at (0, 0) and ends at (0, 4)",
    ),
    "crossing.geojson": (
        json.dumps(feature("Polygon", [RINGS["wall"][[0, 2, 1, 3, 0]].tolist()])),
        "the geometry crosses or touches itself at (2, 2)",
    ),
    "cut.csv": ("0,0\n4,0\n4,4", "ends inside a line"),
    "words.csv": ("0,0\n4,a\n4,4\n", "line 2 must be x, y, got '4,a'"),
    "cut_wkt.csv": ("POLYGON ((0 0, 4 0, 4 4", "a geometry has no closing bracket"),
    "words_wkt.csv": ("POLYGON ((0 0, 4 0, 4 a, 0 0))", "has a geometry that is no text of OGC"),
    "row_wkt.csv": ('wkt,name\n"POLYGON ((0 0, 4 0, 4 4, 0 0))",a\n,b\n', "row without a geometry"),
    "cut.poly": ("4 2 0 0\n1 0 0\n2 4 0\n", "a table has fewer rows"),
    "node.poly": ("1 2 0 0\n1 0 0\n1 0\n1 1 2\n0\n", "node 2, which is not in the file"),
    "inside.poly": (
        "6 2 0 0\n1 0 0\n2 9 0\n3 0 9\n4 1 1\n5 2 1\n6 1 2\n"
        "6 0\n1 1 2\n2 2 3\n3 3 1\n4 4 5\n5 5 6\n6 6 4\n0\n",
        "the ring near (1, 1) is not a hole; lines inside cannot be read",
    ),
    "a.shp": ("\0\0\x27\x0a" + "\0" * 90, "a.shp: cannot be read"),
}


@pytest.mark.filterwarnings("ignore::adaptsize.errors.InputWarning")
@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_files_are_refused_in_one_line(tmp_path, name):
    text, message = DAMAGED[name]
    (tmp_path / name).write_text(text)
    for reader in (read, polygons):
        with pytest.raises(MeshFileError, match=re.escape(message)) as error:
            reader(tmp_path / name)
        assert "\n" not in str(error.value)
        assert name in str(error.value)


def test_the_command_line_meshes_a_file_of_lines(tmp_path, capsys):
    pytest.importorskip("mmgpy")
    geojson_lines(tmp_path / "a.geojson")
    assert call("remesh", tmp_path / "a.geojson", "-o", tmp_path / "a.14", "--hmin", 0.5) == 0
    assert "the lines are simplified within half of the tolerance" in capsys.readouterr().err
    mesh = read(tmp_path / "a.14")
    assert set(mesh.tag_names.values()) == {"wall", "rock"}
    assert mesh.measures.sum() == pytest.approx(15.5, rel=1e-9)
