"""The records of options: defaults, checks, signatures and docstrings that follow from them."""

import importlib
import inspect
import math
import re
from typing import is_typeddict

import numpy as np
import pytest

import adaptsize as ads
from adaptsize import _defaults, options
from adaptsize.domain_size import goals
from adaptsize.errors import InputWarning, ResolutionWarning, TooManyElementsError
from adaptsize.options import (
    AdaptOptions,
    RemeshOptions,
    SizeFunctionOptions,
    bounds,
    checked,
    loops,
    meshes,
    options_of,
    pictures,
    sizes,
)
from adaptsize.options.entrances import ENTRANCES


def test_what_is_not_given_has_its_default():
    options = checked(RemeshOptions, {"backend": "mmg", "hmax": 3})
    assert options["backend"] == "mmg"
    assert options["hmax"] == 3.0
    assert isinstance(options["hmax"], float)
    assert options["timeout"] is None
    assert options.keys() == options_of(RemeshOptions).keys()


@pytest.mark.parametrize(
    ("name", "closest"),
    [("elemnts", "elements"), ("creaseangle", "crease_angle"), ("Hmin", "hmin")],
)
def test_an_unknown_name_is_refused_with_the_closest_one(name, closest):
    with pytest.raises(TypeError, match=f"unexpected option '{name}': did you mean '{closest}'?"):
        checked(SizeFunctionOptions, {name: 1})


def test_an_unknown_name_that_is_like_no_other_is_refused_with_all():
    with pytest.raises(TypeError, match="unexpected option 'xyz': there are backend, timeout, "):
        checked(RemeshOptions, {"xyz": 1})


def test_an_angle_in_radians_draws_a_warning_that_gives_degrees():
    with pytest.warns(InputWarning, match=r"is in degrees, got 0.7; .* pass 40.11"):
        checked(SizeFunctionOptions, {"crease_angle": 0.7})


def test_a_gradient_limit_in_per_cent_draws_a_warning():
    with pytest.warns(InputWarning, match=re.escape("g = 25 hardly limits anything")):
        checked(AdaptOptions, {"g": 25})


def test_a_growth_ratio_in_place_of_a_gradient_is_warned_of_once():
    square = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    with pytest.warns(InputWarning) as found:
        ads.size_function(square, g=1.25)
    assert [str(one.message).partition(";")[2] for one in found] == [
        " a growth ratio of 1.25 from an element to the next is g = 0.25"
    ]
    assert found[0].filename == __file__
    for g in (0.25, 1.0, 2.0):  # 1 is what metrics have
        ads.size_function(square, g=g)


def test_the_signature_shows_the_options():
    parameters = inspect.signature(ads.remesh).parameters
    assert parameters["tolerance"].default == 1e-3
    assert parameters["timeout"].annotation == float | None
    assert parameters["hmax"].default == math.inf
    assert "options" not in parameters


def test_the_docstring_lists_each_option_once():
    entries = re.findall(r"(?m)^([\w, ]+) : ", inspect.getdoc(ads.remesh) or "")
    names = ", ".join(entries).split(", ")
    assert all(names.count(name) == 1 for name in options_of(RemeshOptions))


@pytest.mark.parametrize("function", [ads.adapt, ads.size_function])
def test_the_help_of_a_function_with_many_options_fits_on_two_screens(function):
    # Without the signature, which since Python 3.13 has a line for each parameter.
    assert len((inspect.getdoc(function) or "").splitlines()) <= 100


def test_every_option_is_a_sentence_with_a_type_and_belongs_to_a_group():
    modules = (bounds, loops, meshes, pictures, sizes)
    classes = [c for module in modules for c in vars(module).values() if is_typeddict(c)]
    assert len(classes) > 20
    for record in classes:
        for name, option in options_of(record).items():
            assert option.text[0].isupper(), name
            assert option.text.endswith("."), name
            assert option.group != "Options", name
            assert all(option.doc), name


def test_the_package_exports_the_records_of_public_functions_only():
    modules = [ads, *(importlib.import_module(f"adaptsize.{name}") for name in ads._SUBMODULES)]
    public = [getattr(module, name) for module in modules for name in module.__all__]
    of_functions = {f.__options__.__name__ for f in public if hasattr(f, "__options__")}
    assert {name for name in options.__all__ if name.endswith("Options")} == of_functions


def test_a_growth_ratio_is_another_name_of_the_gradient_limit():
    square = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    source = ads.PointSource([0.2, 0.3], 0.01)
    by_ratio = ads.size_function(square, sources=source, growth=1.2)
    by_gradient = ads.size_function(square, sources=source, g=0.2)
    assert by_ratio.report.g == 0.2
    np.testing.assert_array_equal(by_ratio.values, by_gradient.values)
    with pytest.raises(ValueError, match=r"growth and g exclude each other"):
        ads.size_function(square, growth=1.2, g=0.2)
    with pytest.raises(ValueError, match=r"growth must be finite and >= 1, got 0.2"):
        ads.size_function(square, growth=0.2)
    with pytest.raises(ValueError, match=r"g must be at most 1e\+30, got 1e\+31"):
        ads.size_function(square, growth=1e31)


def test_the_largest_number_of_elements_is_one_option_everywhere():
    options = [options_of(record).get("max_elements") for record in ENTRANCES.values()]
    found = {(one.text, one.details, one.default, one.chosen) for one in options if one is not None}
    assert len(found) == 1


def test_without_a_largest_number_the_same_one_is_refused_everywhere(monkeypatch):
    monkeypatch.setattr(_defaults, "REFUSED_ABOVE", 2000.0)
    monkeypatch.setattr(goals, "RELAXED_TO", 300.0)
    square = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    disc = {"lower": [-1.1, -1.1], "upper": [1.1, 1.1]}
    calls = [
        lambda **most: ads.size_function(square, hmax=0.01, **most),
        lambda **most: ads.remesh(square, 0.01, backend="mmg", **most),
        lambda **most: ads.adapt(square, h0=0.01, backend="bisection", **most),
        lambda **most: ads.mesh_from_distance(lambda x: np.hypot(*x.T) - 1, 0.01, **disc, **most),
    ]
    for refused in calls:
        with pytest.raises(TooManyElementsError, match=r"max_elements = (2e\+03|2000)\b"):
            refused()
        with pytest.raises(TooManyElementsError, match=r"max_elements = (3e\+03|3000)\b"):
            refused(max_elements=3000)
    # What is given may require more than other parameters are relaxed to.
    with pytest.warns(ResolutionWarning, match="more than max_elements = 300: hmax controls"):
        size = ads.size_function(square, hmax=0.05)
    assert 300 < size.report.n_elements < 2000
