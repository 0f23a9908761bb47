"""The examples of images, volumes and the complete size function find what they say."""

import pytest

pytest.importorskip("pyvista", reason="the examples draw")
pytest.importorskip("matplotlib", reason="the examples draw")


def test_objects_of_a_picture_are_meshed_with_their_labels(run, tmp_path):
    found = run("plot_image", every=2, elements_across=2.0)
    assert found["objects"] == 5
    assert found["area of the mesh over that of the pixels"] == pytest.approx(1.0, abs=0.04)
    assert found["smallest angle"] > 15.0
    assert found["share of edges in band"] > 0.95
    assert (tmp_path / "image.png").stat().st_size > 10_000


def test_limiting_takes_the_jumps_out_of_width_and_curvature(run, tmp_path):
    found = run("plot_feature_and_curvature", spacing=0.016)
    assert found["steepest bound over g"] > 3.0
    assert found["steepest size over g"] < 1.0 + 1e-9
    assert found["smallest angle"] > 20.0
    assert found["share of curvature"] > 0.2
    assert found["share of width"] > 0.2
    assert (tmp_path / "feature_and_curvature.png").stat().st_size > 10_000


def test_a_volume_of_two_organs_becomes_two_regions(run, tmp_path):
    found = run("plot_volume", every=3, elements_per_radian=2.0)
    # Cells of some 12 mm cut the common face of the organs as they lie.
    for k in (1, 2):
        name = f"volume of region {k} over that of its voxels"
        assert found[name] == pytest.approx(1.0, abs=0.1)
    assert found["share below 10 degrees"] < 0.002
    assert (tmp_path / "volume.png").stat().st_size > 10_000
    assert (tmp_path / "organs.vtu").exists()
