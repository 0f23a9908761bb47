"""``--source``: its forms; curves as points in the argument, texts and meshes of segments."""

from pathlib import Path

import numpy as np
import pytest

from adaptsize import SimplexMesh, write
from adaptsize.cli.sources import parse_source

DATA = Path(__file__).parents[2] / "data"
POINTS = np.array([[0.5, 0.5], [1.5, 0.5], [1.5, 1.0]])


@pytest.fixture
def curves(tmp_path):
    """The same polyline in all its forms."""
    (tmp_path / "a=1.txt").write_text("# x y\n0.5 0.5\n\n1.5, 0.5 # bend\n1.5\t1.0\n")
    (tmp_path / "a.csv").write_text("0.5,0.5\n1.5,0.5\n1.5,1\n")
    write(tmp_path / "a.vtu", SimplexMesh(POINTS, [[0, 1], [1, 2]]))
    files = [tmp_path / name for name in ("a=1.txt", "a.csv", "a.vtu")]
    return ["curve:0.5,0.5:1.5,0.5:1.5,1=0.02", *(f"curve:{file}=0.02" for file in files)]


def test_points_and_files_give_the_same_curve(curves):
    for text in curves:
        source = parse_source(text)
        assert source.size == 0.02
        np.testing.assert_array_equal(getattr(source.curve, "points", source.curve), POINTS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *(
            (text, "source must be one of")
            for text in ("ball:0,0=1", "point:1,2,x=3", "box:0,0=1", "region=2", "cone:1=2")
        ),
        ("curve:0,0=0.1", "at least 2 points of 2 or 3 coordinates, got 1 points of 2"),
        ("curve:0,0:1,0,0=0.1", "got 2 points of 2 or 3 coordinates"),
        ("curve:0,0:1,0=-1", "size must be positive"),
        ("curve:no-such.txt=1", "no-such.txt: No such file"),
    ],
)
def test_bad_sources_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        parse_source(text)
