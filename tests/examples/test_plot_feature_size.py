"""The example of inscribed spheres finds what its docstring says."""

import pytest

pytest.importorskip("pyvista", reason="the examples draw")


def test_spheres_and_medial_axis_give_the_widths_of_the_part(run, tmp_path):
    found = run("plot_feature_size", spacing=0.08)
    assert found["smallest size"] == pytest.approx(0.25 / 4.0, rel=0.02)
    assert found["elements across the fin"] > 3.9
    assert found["half the width of the foot, spheres"] == pytest.approx(0.6, rel=0.01)
    assert found["half the width of the foot, medial axis"] == pytest.approx(0.6, abs=0.04)
    assert found["web above the hole"] == pytest.approx(0.25, rel=0.04)
    assert (tmp_path / "feature_size.png").stat().st_size > 10_000
