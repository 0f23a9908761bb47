"""The example of curvature from distances, at small settings."""

import pytest

pytest.importorskip("matplotlib", reason="the example draws")


def test_curvature_of_second_order_and_sizes_right_where_they_change(run, tmp_path):
    found = run("plot_level_set_curvature", cells=(40, 80))
    assert found["order, corrected"] > 1.9
    # The shift by phi, up to 2 spacings, is of first order.
    assert found["order, at the nodes"] < 1.5
    assert found["largest error, corrected"] < 0.1 * found["largest error, at the nodes"]
    assert found["largest error, plus sign"] > 1.5 * found["largest error, at the nodes"]
    ours = [found[f"size_from_curvature, largest error {p}"] for p in ("on the boundary", "inside")]
    assert max(ours) < 0.03
    assert found["formula (4), largest error on the boundary"] > 2.0 * ours[0]
    assert found["without - g phi, largest error inside"] > 2.0 * ours[1]
    assert (tmp_path / "level_set_curvature.png").stat().st_size > 10_000
