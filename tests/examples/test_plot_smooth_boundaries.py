"""The example of meshes from distance functions runs and finds what its docstring says."""

import pytest

pytest.importorskip("pyvista", reason="the example draws")


def test_objects_with_smooth_boundaries_are_meshed_to_their_sizes(run, tmp_path):
    # At n_solid = 16 the wall of 0.25 beside the hole is less than two boxes thick.
    found = run("plot_smooth_boundaries", n=90, n_solid=16)
    assert found["share of edges in band"] > 0.95
    assert found["smallest angle"] > 22.0
    # 1.76 around the hole of radius 0.28, between walls at most 0.45 wide: sizes up to 0.18.
    assert found["nodes on the hole"] > 9
    assert found["mesh over domain, area"] == pytest.approx(1.0, abs=0.02)
    assert found["share of edges in band, solid"] > 0.93
    assert found["smallest dihedral angle"] > 15.0
    assert found["slivers"] == 0
    assert found["mesh over domain, volume"] == pytest.approx(1.0, abs=0.03)
    for name in ("smooth_boundaries", "solid"):
        assert (tmp_path / f"{name}.png").stat().st_size > 5_000
