"""Arguments that do not fit are refused by a ValueError of one line, not by one from inside."""

import re
from pathlib import Path

import numpy as np
import pytest

import adaptsize as ads

SQUARE = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
SURFACE = ads.SimplexMesh([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2]])
SIZE = ads.SizeFunction(SQUARE, np.full(4, 0.2))
H0 = np.full(4, 0.2)


def distance(x):
    return np.linalg.norm(x - 0.5, axis=1) - 0.3


WRONG = [
    ("path must be the path of a file", lambda: ads.write("\ud800.vtu", SQUARE)),
    ("names of fields must be a str, got 1", lambda: ads.write("x.vtu", SQUARE, fields={1: H0})),
    (
        "progress must be callable with a text and a number, got",
        lambda: ads.limit_gradient(SQUARE, H0, 0.3, progress=len),
    ),
    (
        "points must be at most 1e+60 in size, got points[0, 0] = 1e+155",
        lambda: ads.SignedDistance(SQUARE)([[1e155, 0.0]]),
    ),
    (
        "overlapping must be an OverlappingBodies, got [(1, 2)]",
        lambda: SURFACE.near_bodies(1.0, overlapping=[(1, 2)]),
    ),
    ("hmin must be a number, got int 1000", lambda: SIZE.clip(hmin=10**400)),
    (
        "label or threshold must be given, got both: str 'xxx",
        lambda: ads.size_function(np.eye(9), label="x" * 5000, threshold=0.5),
    ),
    (
        "directions must be at most 1e+60 in size, got directions[0] = 1e+300",
        lambda: ads.Metric.isotropic(H0, 2).size_along([1e300, 0.0]),
    ),
    (
        "values must be at most 1e+60 in size, got values[1] = 1e+200 (and 2 more)",
        lambda: ads.zz_indicator(SQUARE, 1e200 * np.arange(4.0)),
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
