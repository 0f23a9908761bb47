"""The example of metrics of two points."""

import numpy as np
import pytest


def test_two_ellipses_keep_their_sizes_and_share_the_domain(run, tmp_path):
    found = run("plot_metric_gradation", n_side=41)
    assert found["smallest size"] == pytest.approx(0.02, rel=1e-12)
    # The second point is active at the first one: 0.03 + g 1.84 is less than 0.5.
    distance = np.hypot(1.8, 0.4)
    assert 20.0 < found["largest aspect ratio"] < 25.0
    assert 0.03 + 0.25 * distance < 0.5
    assert found["nodes with both"] > 300
    assert (tmp_path / "metric_gradation.png").stat().st_size > 5_000
