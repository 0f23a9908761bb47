"""The example of the medial axis, at small settings."""

import pytest

pytest.importorskip("matplotlib", reason="the example draws")


def test_feature_sizes_of_planar_shapes_are_those_known(run, tmp_path):
    n = 90
    step = 2.26 / (n - 1)
    found = run("plot_medial_axis", n=n)
    # b^2 / a to b on an ellipse; half the width of a ring and a strip; not small at corners.
    assert found["smallest, ellipse"] == pytest.approx(0.25, abs=2.0 * step)
    assert found["largest, ellipse"] == pytest.approx(0.5, abs=step)
    assert found["smallest, ring"] == pytest.approx(0.3, abs=0.5 * step)
    assert found["largest, ring"] == pytest.approx(0.3, abs=0.5 * step)
    assert found["smallest, rectangle, turned"] == pytest.approx(0.35, abs=step)
    assert found["smallest, L"] == pytest.approx(0.4, abs=step)
    # The cut is 0.5 sqrt(2) long.
    assert found["smallest, corner cut off"] == pytest.approx(0.707, abs=2.0 * step)
    assert found["smallest, wedge of 20 degrees"] < 2.0 * step
    assert found["smallest, wavy disc"] > 0.8
    assert (tmp_path / "medial_axis.png").stat().st_size > 10_000
