"""The example of the medial axis on a quadtree finds what its docstring says."""

import pytest

pytest.importorskip("matplotlib", reason="the example draws")


def test_a_quadtree_refined_by_its_own_size_has_the_widths_of_the_part(run, tmp_path):
    found = run("plot_octree_feature_size", spacing=0.5, rounds=2)
    # Already the first quadtree, whose leaves are wider than the fin, knows how wide it is.
    assert found["half the width of the fin, first quadtree"] == pytest.approx(0.15, rel=0.02)
    assert found["half the width of the fin"] == pytest.approx(0.15, rel=0.01)
    assert found["half the width of the foot"] == pytest.approx(0.6, rel=0.01)
    assert found["half the width of the web above the hole"] == pytest.approx(0.125, rel=0.03)
    assert found["leaves"] < 0.25 * found["leaves of the finest size in the box"]
    assert (tmp_path / "octree_feature_size.png").stat().st_size > 10_000
