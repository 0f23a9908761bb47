"""Arguments that do not fit are refused by a ValueError of one line, not by one from inside."""

import re
from pathlib import Path

import numpy as np
import pytest

import adaptsize as ads
from adaptsize import geometry, limiting, quality, remeshing, sizes

SQUARE = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
TETRAHEDRON = ads.SimplexMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
SURFACE = TETRAHEDRON.boundary().mesh
LINE = SQUARE.boundary().mesh
GRID = ads.CartesianGrid([0.0, 0.0], 0.25, (5, 5))
SIZE = ads.SizeFunction(SQUARE, np.full(4, 0.2))
H0 = np.full(4, 0.2)
TRANSFER = ads.FieldTransfer(SQUARE, SQUARE)
RAGGED = [[1.0], [1.0, 2.0]]
SEVERAL = np.ones(3)


def distance(x):
    return np.linalg.norm(x - 0.5, axis=1) - 0.3


WRONG = {
    "a path that is a number": (lambda: ads.read(1.5), "path must be the path of a file, got 1.5"),
    "a path that is an array": (lambda: ads.read_image(SEVERAL), "path must be the path of a file"),
    "a path to write to": (lambda: ads.write(None, SQUARE), "path must be the path of a file"),
    "is_image_file": (lambda: ads.io.is_image_file(1), "path must be the path of a file, got 1"),
    "a long path": (
        lambda: ads.write("x" * 5000, SQUARE),
        "path must be the path of a file, got str 'xxx",
    ),
    "a null character": (lambda: ads.read("\0"), "path must be the path of a file, got '\\x00'"),
    "a surrogate": (lambda: ads.write("\ud800.vtu", SQUARE), "path must be the path of a file"),
    "fields that are a number": (
        lambda: ads.write("x.vtu", SQUARE, fields=1),
        "fields must be a Mapping, got 1",
    ),
    "a field without a name": (
        lambda: ads.write("x.vtu", SQUARE, fields={1: H0}),
        "names of fields must be a str, got 1",
    ),
    "a long format": (
        lambda: ads.write("x.vtu", SQUARE, file_format="x" * 5000),
        "file_format must be one of",
    ),
    "a format that is a dict": (
        lambda: ads.write("x.vtu", SQUARE, file_format={}),
        "file_format must be one of",
    ),
    "a progress that is a number": (
        lambda: ads.limit_gradient(SQUARE, H0, 0.3, progress=1e9),
        "progress must be callable or True or False, got 1000000000.0",
    ),
    "a progress of one argument": (
        lambda: ads.limit_gradient(SQUARE, H0, 0.3, progress=len),
        "progress must be callable with a text and a number, got",
    ),
    "an order that is an array": (
        lambda: limiting.FastMarching(order=SEVERAL),
        "order must be a number",
    ),
    "face_sources that are text": (
        lambda: limiting.Exact(face_sources="no"),
        "face_sources must be True or False, got 'no'",
    ),
    "a floor that is an array": (
        lambda: limiting.PositiveCoefficient(floor=SEVERAL),
        "floor must be 'hopf-lax' or None, got array",
    ),
    "a method that is a list": (
        lambda: ads.limit_gradient(SQUARE, H0, 0.3, method=["exact"]),
        "method must be one of",
    ),
    "ragged sizes": (lambda: quality.size_conformity(SQUARE, RAGGED), "size must be"),
    "ragged bounds": (
        lambda: ads.adapt(SQUARE, h0=RAGGED),
        "h0 must be",
    ),
    "points out of range": (
        lambda: ads.SignedDistance(SQUARE)([[1e155, 0.0]]),
        "points must be at most 1e+60 in size, got points[0, 0] = 1e+155",
    ),
    "a ragged number": (lambda: SIZE.clip(hmin=RAGGED), "hmin must be a number, got [[1.0], [1.0"),
    "a number that is too large": (
        lambda: SIZE.clip(hmin=10**400),
        "hmin must be a number, got int 1000",
    ),
    "the minimum with an array": (
        lambda: SIZE.minimum(H0),
        "other must be a SizeFunction, got array",
    ),
    "a size on an array": (
        lambda: SIZE.on(H0),
        "background must be a SimplexMesh, a CartesianGrid or an Octree, got array",
    ),
    "sources of a size that are numbers": (
        lambda: ads.SizeFunction(SQUARE, H0, sources=H0),
        "sources must be a SizeSources, got array",
    ),
    "sources that are no list": (
        lambda: ads.size_from_sources(SQUARE, np.array(None)),
        "sources must be a list of them",
    ),
    "a background that is a tuple": (
        lambda: ads.size_function(SQUARE, background=()),
        "background must be a SimplexMesh, a CartesianGrid or an Octree, got ()",
    ),
    "g that is NaN": (
        lambda: ads.size_from_curvature(SURFACE, g=np.nan),
        "g must be finite and >= 0, got nan",
    ),
    "an angle that is NaN, unused": (
        lambda: ads.feature_size(GRID, distance, crease_angle=np.nan),
        "crease_angle must be finite and >= 0, got nan",
    ),
    "an angle that is NaN, with distances": (
        lambda: ads.size_from_feature(GRID, distance, crease_angle=np.nan),
        "crease_angle must be finite and >= 0, got nan",
    ),
    "an angle above 180 degrees": (
        lambda: ads.feature_size(SQUARE, LINE, crease_angle=200.0),
        "crease_angle must be at most 180 degrees, got 200",
    ),
    "a medial axis that is a number": (
        lambda: ads.feature_size(SQUARE, LINE, 3),
        "medial must be a MedialAxis, got 3",
    ),
    "samples of a number": (
        lambda: GRID.sample(np.inf),
        "function must be a function of points, got inf",
    ),
    "a tree of an array": (
        lambda: ads.Octree.build([0, 0], [1, 1], SEVERAL, max_level=2),
        "needs_refinement must be a function of centres and sizes, got array",
    ),
    "a tree that is balanced in parts": (
        lambda: ads.Octree.build(
            [0, 0], [1, 1], lambda x, h: x[:, 0] < 0, max_level=2, balanced=SEVERAL
        ),
        "balanced must be True or False, got array",
    ),
    "names of tags that are a function": (
        lambda: ads.SimplexMesh(SQUARE.points, SQUARE.cells, tag_names=distance),
        "tag_names must be a Mapping, got <function distance",
    ),
    "sources that are an array": (
        lambda: ads.size_function(SQUARE, sources=np.array(0.1)),
        "sources must be a list of them, got array(0.1)",
    ),
    "a background that is a long text": (
        lambda: ads.size_function(distance, background="x" * 5000),
        "background must be a SimplexMesh, a CartesianGrid or an Octree, got str 'xxx",
    ),
    "a label and a threshold": (
        lambda: ads.size_function(np.eye(9), label="x" * 5000, threshold=0.5),
        "label or threshold must be given, got both: str 'xxx",
    ),
    "None among numbers": (
        lambda: ads.SizeFunction(SQUARE, [0.1, None, 0.1, 0.1]),
        "must be an array of numbers, got [0.1, None, 0.1, 0.1]",
    ),
    "directions out of range": (
        lambda: ads.isotropic_metric(H0, 2).size_along([1e300, 0.0]),
        "directions must be at most 1e+60 in size, got directions[0] = 1e+300",
    ),
    "values out of range": (
        lambda: ads.zz_indicator(SQUARE, 1e200 * np.arange(4.0)),
        "values must be at most 1e+60 in size, got values[1] = 1e+200 (and 2 more)",
    ),
    "at_boundary that is text": (
        lambda: geometry.level_set_curvature(GRID, GRID.sample(distance), at_boundary="abc"),
        "at_boundary must be True or False, got 'abc'",
    ),
    "faces of an array": (
        lambda: geometry.tag_faces(H0),
        "surface must be a SimplexMesh, got array",
    ),
    "integrals of other meshes": (
        lambda: TRANSFER.integrals(SEVERAL, SEVERAL),
        "old_values must have 2 rows",
    ),
    "a transfer that is conservative in parts": (
        lambda: TRANSFER.cells([1.0, 2.0], conservative=SEVERAL),
        "conservative must be True or False, got array",
    ),
    "a transfer of fields that is conservative in parts": (
        lambda: ads.transfer_fields(SQUARE, SQUARE, conservative=SEVERAL),
        "conservative must be True or False, got array",
    ),
    "flatten that is text": (
        lambda: ads.SimplexMesh.from_meshio(SQUARE.to_meshio(), flatten="no"),
        "flatten must be True or False, got 'no'",
    ),
    "flatten of a file that is NaN": (
        lambda: ads.read("part.stl", flatten=np.nan),
        "flatten must be True or False, got nan",
    ),
    "a tag name that is an array": (
        lambda: SQUARE.to_meshio(tag_name=SEVERAL),
        "tag_name must be a str, got array",
    ),
    "a gradient limit that is text": (
        lambda: ads.size_from_error(SQUARE, [0.1, 0.2], order=1, tolerance=0.1, g="0.3"),
        "g must be an array of numbers, got '0.3'",
    ),
    "a backend that is a list": (
        lambda: sizes.predicted_elements(SQUARE, H0, backend=["mmg"]),
        "backend must be a str, got ['mmg']",
    ),
    "an estimate for an array": (
        lambda: remeshing.estimate_n_cells(H0, SIZE),
        "mesh must be a SimplexMesh, got array",
    ),
    "an estimate for a number": (
        lambda: remeshing.estimate_n_cells(SQUARE, 0.1),
        "size must be a function of points, got 0.1",
    ),
    "an estimate for a column": (
        lambda: remeshing.estimate_n_cells(SQUARE, lambda x: np.ones((len(x), 1))),
        "size(points) must have shape (4,), got (4, 1)",
    ),
    "a seed that is NaN": (
        lambda: ads.mesh_from_distance(distance, 0.1, [0, 0], [1, 1], seed=np.nan),
        "seed must be finite and >= 0, got nan",
    ),
    "a picture of an array": (
        lambda: ads.plot.plot_mesh(H0),
        "mesh must be a SimplexMesh, got array",
    ),
    "a picture of a report that is none": (
        lambda: ads.plot.plot_causes(H0),
        "report must be a SizeReport, got array",
    ),
    "a label that is a pair": (
        lambda: ads.plot.plot_size(SQUARE, H0, label=(0.1, 0.2)),
        "label must be a str, got (0.1, 0.2)",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_refused_by_one_clear_line(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call, expected = WRONG[case]
    with pytest.raises(ValueError, match=re.escape(expected)) as raised:
        call()
    assert len(str(raised.value)) < 1000
    assert "\n" not in str(raised.value)
    assert not list(Path().iterdir())


def test_angles_and_ratios_of_cells_as_small_as_the_range_allows():
    tiny = ads.SimplexMesh(1e-59 * TETRAHEDRON.points, TETRAHEDRON.cells)
    assert quality.minimum_angles(tiny) == pytest.approx(quality.minimum_angles(TETRAHEDRON))
    assert quality.radius_ratios(tiny) == pytest.approx(quality.radius_ratios(TETRAHEDRON))
