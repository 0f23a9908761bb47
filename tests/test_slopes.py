"""Every function that takes a gradient limit has the same range and the same messages."""

import numpy as np
import pytest

import adaptsize as ads

SQUARE = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
SHEET = ads.SimplexMesh([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2]])
H0 = np.array([0.2, 0.4, 0.6, 0.5])
METRIC = ads.Metric.isotropic(H0, 2)
POINT = ads.PointSource([0.5, 0.5], 0.1)
TAKERS = {
    "size_function": lambda g: ads.size_function(SQUARE, g=g),
    "limit_gradient": lambda g: ads.limit_gradient(SQUARE, H0, g),
    "limit_on_sphere": lambda g: ads.limit_on_sphere(SQUARE.points, H0, g),
    "limit_metric": lambda g: ads.limit_metric(SQUARE, METRIC, g),
    "size_from_sources": lambda g: ads.size_from_sources(SQUARE, POINT, g=g),
    "size_from_error": lambda g: ads.size_from_error(SQUARE, H0[:2], elements=4, order=1.0, g=g),
    "SizeFunction": lambda g: ads.SizeFunction(SHEET, H0[:3], g=g),
    "sparse": lambda g: ads.SizeFunction(SQUARE, H0).sparse(g),
    "refine_to_size": lambda g: ads.refine_to_size(lambda x: x[:, 0] + 1.0, g=g),
    "adapt": lambda g: ads.adapt(SQUARE, h0=H0, g=g),
}
REFUSED = {
    -0.1: "g must be finite and >= 0, got -0.1",
    np.nan: "g must be finite and >= 0, got nan",
    np.inf: "g must be finite and >= 0, got inf",
    2e30: "g must be at most 1e+30, got 2e+30",
}


@pytest.mark.parametrize("taker", TAKERS)
def test_gradient_limits_have_one_range(taker):
    for g, text in REFUSED.items():
        with pytest.raises(ValueError, match=r"^g ") as refused:
            TAKERS[taker](g)
        assert str(refused.value) == text
    for g in (0.0, 1e-300, 1e-31, 0.25, 1) if taker != "adapt" else ():  # which makes a mesh
        TAKERS[taker](g)


def test_each_value_of_an_array_has_the_same_range():
    for bad in (-0.1, np.nan, np.inf, 2e30):
        with pytest.raises(ValueError, match=r"^g ") as refused:
            ads.limit_gradient(SQUARE, H0, [0.1, bad])
        assert str(refused.value) == REFUSED[bad].replace("got ", "got g[1] = ")


def test_a_slope_whose_square_underflows_is_none():
    h = ads.limit_gradient(SQUARE, [0.2, *3 * [np.inf]], 1e-31)
    assert h.tolist() == [0.2] * 4
    tiny = ads.SizeFunction(SHEET, H0[:3], g=1e-31)
    assert tiny.g == 0.0


@pytest.mark.parametrize("taker", ["size_function", "size_from_error"])
def test_limits_that_look_like_percentages_are_warned_of(taker):
    TAKERS[taker](9.0)
    with pytest.warns(ads.errors.InputWarning, match="g = 10 hardly limits anything"):
        TAKERS[taker](10.0)
