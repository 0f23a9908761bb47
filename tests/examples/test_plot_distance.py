"""The example of signed distances runs, at small settings, and finds what it says."""

import pytest

pytest.importorskip("matplotlib", reason="the example draws")


def test_signed_distances_of_a_function_an_outline_pixels_and_a_part(run, tmp_path):
    found = run("plot_distance", n=60)
    assert found["largest error, spacings"] < 0.02
    # A node beside a gap of 0.05 may lie on either side of what closes it.
    assert found["share of right signs beside the gaps"] > 0.99
    assert found["mean error, pixels"] < 0.2
    assert found["volume inside over that of the part"] == pytest.approx(1.0, abs=0.03)
    assert (tmp_path / "distance.png").stat().st_size > 10_000
