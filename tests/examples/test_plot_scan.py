"""The example of a scanned figurine runs and finds what its docstring says."""

import numpy as np
import pytest
from curved_shapes import smooth_torus

import adaptsize as ads

pytest.importorskip("pyvista", reason="the example draws")


def test_a_scan_is_meshed_finely_where_it_is_thin_and_curved(run, tmp_path):
    ring, _ = smooth_torus(24)
    noise = np.random.default_rng(1709).normal(0.0, 0.001, ring.points.shape)
    scan = ads.SimplexMesh(ring.points + noise, ring.cells)
    found = run("plot_scan", scan=scan, spacing=0.07, hmax=1.0)
    # Three per radius of 0.4, less up to a quarter for noise; inside, 0.3 * 0.4 more at most.
    assert 0.1 < found["smallest size"] < 0.14
    assert 0.16 < found["largest size"] < 0.27
    # Noise is rough within the tolerance, which keeps many edges of the surface short.
    assert found["share of edges in band"] > 0.6
    assert found["smallest dihedral angle"] > 6.0
    assert found["distance over diagonal"] < 0.004
    assert (tmp_path / "scan.png").stat().st_size > 20_000
