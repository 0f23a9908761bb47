"""Checks of arguments: what passes, and the text of what does not."""

import re
from functools import partial

import numpy as np
import pytest

from adaptsize import CartesianGrid, Octree, SimplexMesh, limit_gradient
from adaptsize._checks import (
    as_float_array,
    as_index_array,
    as_number,
    as_plain_array,
    as_points,
    as_sizes,
    as_slope,
    as_slopes,
    as_whole_number,
    check_type,
    describe,
    one_of,
    refuse_where,
)
from adaptsize.background import Image

SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
AT_LEAST_0 = partial(as_number, lower=0.0)
UP_TO_1000 = partial(as_whole_number, lower=0, upper=1000)


def test_what_fits_passes():
    for given in (3, [1, 2], np.arange(6, dtype=np.int8).reshape(2, 3).T):
        array = as_float_array("a", given)
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
        assert array.shape == np.shape(given)
        assert (array == np.asarray(given)).all()
    assert as_float_array("h", np.ma.masked_array([1.0, 2.0])).tolist() == [1.0, 2.0]
    assert as_points("p", np.zeros((0, 2)), 2).shape == (0, 2)
    assert as_index_array("i", [[0, 4]], 5).tolist() == [[0, 4]]
    assert as_index_array("i", [[1.0, 2.0]], 5).dtype == np.int32
    assert as_index_array("i", np.array([[0, 300]], ">i2"), 301).tolist() == [[0, 300]]
    assert as_points("p", [[1e308, 1e308]], 2).tolist() == [[1e308, 1e308]]  # whose sum is inf
    assert as_sizes("h", [1, np.inf], (2,)).tolist() == [1.0, np.inf]
    for number in (0.0, 1e-60, 1e60, np.inf):  # whose squares are in range
        assert as_number("h", number, lower=0.0, allow_inf=True) == number
    assert as_whole_number("n", 1000.0, lower=0, upper=1000) == 1000
    assert as_slope("g", 1e30) == 1e30
    assert as_slopes("g", np.array([0.0, 1e-31, 1e-30, 1e30])).tolist() == [0.0, 0.0, 1e-30, 1e30]
    assert one_of("m", "b", ("a", "b")) == "b"
    refuse_where("a", np.zeros(3, bool), np.ones(3), "must be")
    check_type("mesh", SQUARE, CartesianGrid, SimplexMesh)


def test_long_values_are_cut_in_messages():
    assert describe(0.3) == "0.3"
    assert len(describe(list(range(1000)))) < 70
    assert describe(list(range(1000))).startswith("list [0, 1,")


HOLES = np.ma.masked_array([1.0, 2.0, 3.0], [False, True, True])
UNMASKED = "must not have masked entries (see numpy.ma.filled), got "
TEXTS = ("0.1", b"0.1", np.str_("0.1"))
COMPLEX = [np.array([1.0, complex(1.0, imaginary)]) for imaginary in (0.0, 1.0)]
REFUSED = [
    ("a must have shape (3,), got (2,)", as_float_array, ["a", [1.0, 2.0], (3,)]),
    ("a must be an array of numbers, got [[1], [2, 3]]", as_float_array, ["a", [[1], [2, 3]]]),
    ("p must have shape (n, 3), got (1, 2)", as_points, ["p", [[1.0, 2.0]], 3]),
    ("p must be finite, got p[1, 0] = nan (and 1 more)",
     as_points, ["p", [[0.0, 1.0], [np.nan, np.inf]], 2]),
    ("p must be finite, got p[0, 0] = inf (and 1 more)", as_points, ["p", [[np.inf, -np.inf]], 2]),
    ("i must be indices from 0 to 4, got i[0, 1] = 5", as_index_array, ["i", [[0, 5]], 5]),
    *(("i must be indices from 0 to 4, got i[0, 1] = -3...",
       as_index_array, ["i", np.array([[0, -3]], kind), 5]) for kind in ("i1", ">i4", "f8")),
    ("i must be indices from 0 to 4, got i[0, 0] = -1", as_index_array, ["i", [[-1, 0]], 5]),
    ("i must be indices from 0 to 4, got i[0, 0] = 4294967297",  # not wrapped to 1
     as_index_array, ["i", [[2**32 + 1, 0]], 5]),
    *(("i must be integers, got ...", as_index_array, ["i", [bad], 5])
      for bad in ([0.5, 1.0], ["a", "b"], [True, False], [np.nan, 1.0])),
    ("h must be positive (inf where there is no bound), got h[1] = nan",
     as_sizes, ["h", [1.0, np.nan], (2,)]),
    ("x must be finite and > 0, got 0", partial(as_number, lower=0.0, strict=True), ["x", 0.0]),
    ("x must be finite and >= 1, got 0.5", partial(as_number, lower=1.0), ["x", 0.5]),
    ("x must be >= 0, got nan", partial(as_number, lower=0.0, allow_inf=True), ["x", np.nan]),
    ("h must be at least 1e-60, got 4.94066e-324", AT_LEAST_0, ["h", 5e-324]),
    ("h must be at most 1e+60, got 1e+155", AT_LEAST_0, ["h", 1e155]),
    *((f"x must be a number, got {bad!r}", AT_LEAST_0, ["x", bad]) for bad in ([1, 2], *TEXTS)),
    *((f"a must be an array of numbers, got {bad!r}", as_float_array, ["a", bad])
      for text in TEXTS for bad in (text, [text, text])),
    ("x must be a number, got masked", AT_LEAST_0, ["x", np.ma.masked]),
    *((f"h {UNMASKED}h[1] = -- (and 1 more)", check, ["h", HOLES])
      for check in (as_plain_array, as_float_array)),
    *((f"h[1] {UNMASKED}h[1][1] = -- (and 1 more)", check, ["h", [np.ones(3), HOLES]])
      for check in (as_plain_array, as_float_array)),
    ("i must not have masked entries...",
     as_index_array, ["i", np.ma.masked_array([[0, 1]], [[False, True]]), 5]),
    *(("h must be real, got complex128 of shape (2,)", as_float_array, ["h", given])
      for a in COMPLEX for given in (a, a.tolist())),
    *(("x must be a number, got ...", AT_LEAST_0, ["x", a[1]]) for a in COMPLEX),
    ("m must be one of 'a', 'b', got 'c'", one_of, ["m", "c", ("a", "b")]),
    ("a must be less, got a[1, 0] = 3.0 (and 1 more)", refuse_where,
     ["a", np.array([[False], [True], [True]]), np.array([[2.0], [3.0], [4.0]]), "must be less"]),
    ("mesh must be a SimplexMesh, got None", check_type, ["mesh", None, SimplexMesh]),
    ("on must be a SimplexMesh, a CartesianGrid or an Octree, got 'a.vtu'; read(path) gives one",
     check_type, ["on", "a.vtu", SimplexMesh, CartesianGrid, Octree]),
    ("n must be at most 1000, got 1001", UP_TO_1000, ["n", 1001]),
    ("n must be a whole number, got 0.5", UP_TO_1000, ["n", 0.5]),
    ("g must be at most 1e+30, got 1e+300", as_slope, ["g", 1e300]),
]  # fmt: skip
"""Messages, which may go on at three dots, and checks with their arguments."""


@pytest.mark.parametrize(("expected", "check", "arguments"), REFUSED)
def test_what_does_not_fit_is_refused(expected, check, arguments):
    with pytest.raises(ValueError, match="^" + re.escape(expected.removesuffix("..."))) as raised:
        check(*arguments)
    assert expected.endswith("...") or str(raised.value) == expected


MASKED = np.ma.masked_array([True, False, True], [False, True, False])
NUMBERS = np.ma.masked_array([1, 2, 3], [False, True, False])
ARRAYS = {
    "active": lambda: CartesianGrid([0.0], 1.0, (3,), active=MASKED),
    "point_data['u']": lambda: SQUARE.with_data(
        point_data={"u": np.ma.masked_equal([0, 1, 2, 3], 1)}
    ),
    "cell_tags": lambda: SimplexMesh(SQUARE.points, SQUARE.cells, cell_tags=NUMBERS[:2]),
    "points": lambda: SimplexMesh(np.ma.masked_less(SQUARE.points, 0.5), SQUARE.cells),
    "levels": lambda: Octree([0.0, 0.0], [2.0, 1.0], (2, 1), NUMBERS),
    "values": lambda: Image(np.ma.masked_equal([[0, 1], [1, 0]], 1)),
    "h0": lambda: limit_gradient(SQUARE, np.ma.masked_less([0.1, 1.0, 1.0, 1.0], 0.5), 0.2),
    "g": lambda: limit_gradient(SQUARE, np.ones(4), np.ma.masked_less([0.1, 0.2, 0.2, 0.2], 0.15)),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_no_array_argument_loses_its_mask(name):
    with pytest.raises(ValueError, match=f"^{re.escape(name)} must not have masked entries"):
        ARRAYS[name]()
