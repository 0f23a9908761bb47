"""Bad values of every option of every public function, generated from the records of options."""

import re

import numpy as np
import pytest

import adaptsize as ads
from adaptsize._size_report import SizeReport
from adaptsize.options import options_of
from adaptsize.plot import pictures

SQUARE = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
ETA, FIELD = np.ones(2), np.arange(4.0)
PIXELS = np.pad(np.ones((9, 9), bool), 2)
#: Without fields: options are checked before any is read.
REPORT = SizeReport.__new__(SizeReport)


def distance(x):
    return np.linalg.norm(x - 0.5, axis=1) - 0.3


#: The arguments besides the options.
CALLS = {
    ads.size_function: (PIXELS,),
    ads.mesh_image: (PIXELS,),
    ads.remesh: (SQUARE, 0.1),
    ads.remesh_to_elements: (SQUARE, 1000),
    ads.mesh_family: (SQUARE,),
    ads.mesh_from_distance: (distance, 0.1, [0, 0], [1, 1]),
    ads.adapt: (SQUARE, ETA),
    ads.needs_remeshing: (SQUARE, 0.1),
    ads.size_from_error: (SQUARE, ETA),
    ads.size_from_hessian: (SQUARE, FIELD),
    ads.size_from_curvature: (SQUARE,),
    ads.size_from_feature: (SQUARE,),
    ads.transfer_fields: (SQUARE, SQUARE),
    pictures.plot_mesh: (SQUARE,),
    pictures.plot_size: (SQUARE, FIELD + 1.0),
    pictures.plot_metric: (ads.MetricFunction(SQUARE, ads.Metric.isotropic(FIELD + 1.0, 2)),),
    pictures.plot_causes: (REPORT,),
}
#: Required keywords.
ORDER = {ads.size_from_error: {"order": 1}}


def bad_values(option):
    """Return values that an option must refuse, by its type and range."""
    values = [] if option.optional else [None]
    if option.type in (float, int):
        values += [np.nan, "0.3", [1.0, 2.0], 1j, np.ma.masked, 10**400, lambda x: x]
        if np.isfinite(option.lower):
            values += [option.lower if option.above else np.nextafter(option.lower, -9.0), -np.inf]
        values += [] if option.inf else [np.inf]
        values += [] if option.upper is None else [1.001 * option.upper]
        values += [1.5] if option.type is int else []
        return values
    if option.type is bool:
        return [*values, "no", 1, 0.0, np.nan, [True], np.ones(3)]
    if option.choices:
        return [*values, "nothing", 3, [option.choices[0]], np.ones(3), "x" * 5000]
    return []


CASES = [
    pytest.param(function, name, value, id=f"{function.__name__}-{name}-{str(value)[:20]}")
    for function in CALLS
    for name, option in options_of(function.__options__).items()
    for value in bad_values(option)
]


@pytest.mark.parametrize(("function", "name", "value"), CASES)
def test_a_bad_value_is_refused_by_one_line_that_names_the_option(function, name, value):
    with pytest.raises(ValueError, match=f"^{name} must be ") as raised:
        function(*CALLS[function], **ORDER.get(function, {}), **{name: value})
    assert len(str(raised.value)) < 300
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("function", CALLS)
def test_an_unknown_option_is_refused_with_the_closest_name(function):
    name = next(iter(options_of(function.__options__)))
    with pytest.raises(TypeError, match=re.escape(f"did you mean {name!r}?")):
        function(*CALLS[function], **ORDER.get(function, {}), **{f"{name}x": 1})


def test_every_public_function_with_options_is_swept():
    public = [getattr(ads, name) for name in ads.__all__]
    public += [getattr(pictures, name) for name in dir(pictures) if name.startswith("plot_")]
    assert {f for f in public if hasattr(f, "__options__")} == set(CALLS)
