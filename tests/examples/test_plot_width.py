"""The example of width and separation finds what its docstring says."""

import pytest

pytest.importorskip("matplotlib", reason="the example draws")


def test_the_width_resolves_walls_and_the_separation_gaps_between_corners(run, tmp_path):
    found = run("plot_width")
    assert found["smallest width"] == pytest.approx(0.25, rel=2e-3)  # below the hole
    assert found["smallest separation"] == pytest.approx(0.15, rel=1e-12)  # of step and slot
    assert found["separation there"] == pytest.approx(found["gap of the windows"], rel=1e-12)
    # Half a box of the grid away from the corners, with g = 0.25.
    assert found["size from the separation there"] < 1.15 * found["gap of the windows"]
    assert found["size from the width there"] > 2.0 * found["gap of the windows"]
    assert found["elements across the fin"] == pytest.approx(2.0, rel=1e-9)
    assert (tmp_path / "width.png").stat().st_size > 10_000
