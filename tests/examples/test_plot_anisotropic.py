"""The examples with metrics, small: their claims hold and their pictures are drawn."""

import pytest

pytest.importorskip("mmgpy")
pytest.importorskip("matplotlib", reason="the examples draw")


def test_stretched_triangles_need_fewer_elements(run, tmp_path):
    numbers = {"isotropic": (750, 1500), "anisotropic": (250, 500)}
    found = run("plot_anisotropic_layers", numbers=numbers)
    for name in ("S-shaped", "crossing"):
        errors = {
            kind: [float(e) for e in found[f"{name}, {kind}: errors"].split()]
            for kind in ("isotropic", "anisotropic")
        }
        # A third of the triangles, and still a smaller error.
        assert errors["anisotropic"][-1] < 0.7 * errors["isotropic"][-1]
    assert found["crossing: largest aspect ratio"] > 10.0
    for name in ("anisotropic_layers", "anisotropic_layers_metric"):
        assert (tmp_path / f"{name}.png").stat().st_size > 1000


def test_layers_have_the_requested_heights(run, tmp_path):
    found = run("plot_boundary_layer", first=1e-3)
    assert found["growth of the heights"] == pytest.approx(1.2, abs=0.03)
    assert found["height at the wall by the fit"] == pytest.approx(1e-3, rel=0.1)
    assert found["first height over the requested, median"] == pytest.approx(1.0, rel=0.25)
    assert found["share of edges in band"] > 0.9
    assert found["wall nodes off the wall"] < 2e-4  # a fifth of the first height
    assert found["jump of the height between neighbours, 99 %"] < 3.0
    assert (tmp_path / "boundary_layer.png").stat().st_size > 1000


def test_triangles_are_stretched_along_the_shocks(run, tmp_path):
    found = run("plot_euler_anisotropic", numbers=(400, 350), n_cycles=1, n_first=600)
    assert found["largest aspect ratio, anisotropic"] > 3.0
    assert found["boundary nodes off the boundary, anisotropic"] < 1e-9
    assert 1.3 < found["largest Mach number, anisotropic"] < 2.3
    assert (tmp_path / "euler_anisotropic.png").stat().st_size > 1000
