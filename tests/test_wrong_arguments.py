"""Arguments that do not fit are refused by a ValueError of one line, not by one from inside."""

import re
from pathlib import Path

import numpy as np
import pytest

import adaptsize as ads
from adaptsize import limiting

SQUARE = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
TETRAHEDRON = ads.SimplexMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
LINE = SQUARE.boundary().mesh
GRID = ads.CartesianGrid([0.0, 0.0], 0.25, (5, 5))
SIZE = ads.SizeFunction(SQUARE, np.full(4, 0.2))
H0 = np.full(4, 0.2)
TRANSFER = ads.FieldTransfer(SQUARE, SQUARE)
SEVERAL = np.ones(3)


def distance(x):
    return np.linalg.norm(x - 0.5, axis=1) - 0.3


WRONG = [
    ("path must be the path of a file", lambda: ads.read_image(SEVERAL)),
    ("path must be the path of a file, got str 'xxx", lambda: ads.write("x" * 5000, SQUARE)),
    ("path must be the path of a file, got '\\x00'", lambda: ads.read("\0")),
    ("path must be the path of a file", lambda: ads.write("\ud800.vtu", SQUARE)),
    ("names of fields must be a str, got 1", lambda: ads.write("x.vtu", SQUARE, fields={1: H0})),
    (
        "progress must be callable or True or False, got 1000000000.0",
        lambda: ads.limit_gradient(SQUARE, H0, 0.3, progress=1e9),
    ),
    (
        "progress must be callable with a text and a number, got",
        lambda: ads.limit_gradient(SQUARE, H0, 0.3, progress=len),
    ),
    (
        "floor must be 'hopf-lax' or None, got array",
        lambda: limiting.PositiveCoefficient(floor=SEVERAL),
    ),
    (
        "points must be at most 1e+60 in size, got points[0, 0] = 1e+155",
        lambda: ads.SignedDistance(SQUARE)([[1e155, 0.0]]),
    ),
    ("hmin must be a number, got int 1000", lambda: SIZE.clip(hmin=10**400)),
    ("sources must be a list of them", lambda: ads.size_from_sources(SQUARE, np.array(None))),
    ("medial must be a MedialAxis, got 3", lambda: ads.feature_size(GRID, LINE, 3)),
    ("function must be a function of points, got inf", lambda: GRID.sample(np.inf)),
    (
        "needs_refinement must be a function of centres and sizes, got array",
        lambda: ads.Octree.build([0, 0], [1, 1], SEVERAL, max_level=2),
    ),
    (
        "background must be a SimplexMesh, a CartesianGrid or an Octree, got str 'xxx",
        lambda: ads.size_function(distance, background="x" * 5000),
    ),
    (
        "label or threshold must be given, got both: str 'xxx",
        lambda: ads.size_function(np.eye(9), label="x" * 5000, threshold=0.5),
    ),
    (
        "must be an array of numbers, got [0.1, None, 0.1, 0.1]",
        lambda: ads.SizeFunction(SQUARE, [0.1, None, 0.1, 0.1]),
    ),
    (
        "directions must be at most 1e+60 in size, got directions[0] = 1e+300",
        lambda: ads.Metric.isotropic(H0, 2).size_along([1e300, 0.0]),
    ),
    (
        "values must be at most 1e+60 in size, got values[1] = 1e+200 (and 2 more)",
        lambda: ads.zz_indicator(SQUARE, 1e200 * np.arange(4.0)),
    ),
    ("old_values must have 2 rows", lambda: TRANSFER.integrals(SEVERAL, SEVERAL)),
    (
        "g must be an array of numbers, got '0.3'",
        lambda: ads.size_from_error(SQUARE, [0.1, 0.2], order=1, tolerance=0.1, g="0.3"),
    ),
    (
        "size must be a function of points, got 0.1",
        lambda: ads.sizes.predict(ads.sizes.Enclosed(TETRAHEDRON.boundary().mesh), 0.1),
    ),
    (
        "size(points) must have shape (4,), got (4, 1)",
        lambda: ads.sizes.predict(SQUARE, lambda x: np.ones((len(x), 1))),
    ),
]


@pytest.mark.parametrize(("expected", "call"), WRONG)
def test_wrong_arguments_are_refused_by_one_clear_line(expected, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=re.escape(expected)) as raised:
        call()
    assert len(str(raised.value)) < 1000
    assert "\n" not in str(raised.value)
    assert not list(Path().iterdir())
