"""Checks of arguments: what passes, and the text of what does not."""

import re

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
    as_whole_number,
    check_type,
    describe,
    one_of,
    refuse_where,
)
from adaptsize.background import Image


def message(expected):
    return pytest.raises(ValueError, match="^" + re.escape(expected) + "$")


def test_float_arrays_keep_their_shape_and_become_float64():
    for given in (3, [1, 2], np.arange(6, dtype=np.int8).reshape(2, 3).T):
        array = as_float_array("a", given)
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
        assert array.shape == np.shape(given)
        assert (array == np.asarray(given)).all()


def test_float_arrays_name_the_shape_that_is_wanted():
    with message("a must have shape (3,), got (2,)"):
        as_float_array("a", [1.0, 2.0], (3,))
    with message("a must be an array of numbers, got [[1], [2, 3]]"):
        as_float_array("a", [[1], [2, 3]])


def test_no_points_are_points_too():
    assert as_points("p", np.zeros((0, 2)), 2).shape == (0, 2)
    with message("p must have shape (n, 3), got (1, 2)"):
        as_points("p", [[1.0, 2.0]], 3)
    with message("p must be finite, got p[1, 0] = nan (and 1 more)"):
        as_points("p", [[0.0, 1.0], [np.nan, np.inf]])


def test_both_ends_of_the_range_of_indices():
    assert as_index_array("i", [[0, 4]], 5).tolist() == [[0, 4]]
    with message("i must be indices from 0 to 4, got i[0, 1] = 5"):
        as_index_array("i", [[0, 5]], 5)
    with message("i must be indices from 0 to 4, got i[0, 0] = -1"):
        as_index_array("i", [[-1, 0]], 5)


def test_indices_are_whole_numbers():
    assert as_index_array("i", [[1.0, 2.0]], 5).dtype == np.int32
    for bad in ([[0.5, 1.0]], [["a", "b"]], [[True, False]], [[np.nan, 1.0]]):
        with pytest.raises(ValueError, match="i must be integers, got "):
            as_index_array("i", bad, 5)
    with message("i must be indices from 0 to 4, got i[0, 0] = 4294967297"):
        as_index_array("i", [[2**32 + 1, 0]], 5)  # not wrapped to 1


def test_sizes_are_positive_and_may_be_infinite():
    assert as_sizes("h", [1, np.inf], (2,)).tolist() == [1.0, np.inf]
    with message("h must be positive (inf where there is no bound), got h[1] = nan"):
        as_sizes("h", [1.0, np.nan], (2,))


def test_numbers_keep_to_their_bounds():
    assert as_number("x", 0, lower=0.0) == 0.0
    assert as_number("x", np.inf, lower=0.0, allow_inf=True) == np.inf
    with message("x must be finite and > 0, got 0"):
        as_number("x", 0.0, lower=0.0, strict=True)
    with message("x must be finite and >= 1, got 0.5"):
        as_number("x", 0.5, lower=1.0)
    with message("x must be >= 0, got nan"):
        as_number("x", np.nan, lower=0.0, allow_inf=True)
    with message("x must be a number, got [1, 2]"):
        as_number("x", [1, 2], lower=0.0)


@pytest.mark.parametrize("text", ["0.1", b"0.1", np.str_("0.1")])
def test_text_is_no_number(text):
    with message(f"x must be a number, got {text!r}"):
        as_number("x", text, lower=0.0)
    with message(f"a must be an array of numbers, got {text!r}"):
        as_float_array("a", text)
    with message(f"a must be an array of numbers, got {[text, text]!r}"):
        as_float_array("a", [text, text])


def test_words_are_chosen_from_a_list():
    assert one_of("m", "b", ("a", "b")) == "b"
    with message("m must be one of 'a', 'b', got 'c'"):
        one_of("m", "c", ("a", "b"))


def test_long_values_are_cut_in_messages():
    assert describe(0.3) == "0.3"
    assert len(describe(list(range(1000)))) < 70
    assert describe(list(range(1000))).startswith("list [0, 1,")


def test_nothing_bad_is_no_error():
    refuse_where("a", np.zeros(3, bool), np.ones(3), "must be")
    with message("a must be less, got a[1, 0] = 3.0 (and 1 more)"):
        refuse_where(
            "a",
            np.array([[False], [True], [True]]),
            np.array([[2.0], [3.0], [4.0]]),
            "must be less",
        )


def test_masked_entries_are_refused_and_named():
    masked = np.ma.masked_array([1.0, 2.0, 3.0], [False, True, True])
    wanted = "must not have masked entries (see numpy.ma.filled), got "
    for check in (as_plain_array, as_float_array):
        with message(f"h {wanted}h[1] = -- (and 1 more)"):
            check("h", masked)
        with message(f"h[1] {wanted}h[1][1] = -- (and 1 more)"):
            check("h", [np.ones(3), masked])
    with pytest.raises(ValueError, match="i must not have masked entries"):
        as_index_array("i", np.ma.masked_array([[0, 1]], [[False, True]]), 5)
    with message("x must be a number, got masked"):
        as_number("x", np.ma.masked, lower=0.0)


@pytest.mark.parametrize("imaginary", [0.0, 1.0])
def test_complex_numbers_are_refused_where_real_ones_are_wanted(imaginary):
    given = np.array([1.0, complex(1.0, imaginary)])
    with message("h must be real, got complex128 of shape (2,)"):
        as_float_array("h", given)
    with message("h must be real, got complex128 of shape (2,)"):
        as_float_array("h", given.tolist())
    with pytest.raises(ValueError, match="x must be a number, got "):
        as_number("x", given[1], lower=0.0)


MASKED = np.ma.masked_array([True, False, True], [False, True, False])
NUMBERS = np.ma.masked_array([1, 2, 3], [False, True, False])
SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
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


def test_types_that_are_wanted_are_listed():
    check_type("mesh", SQUARE, CartesianGrid, SimplexMesh)
    with message("mesh must be a SimplexMesh, got None"):
        check_type("mesh", None, SimplexMesh)
    with message("on must be a SimplexMesh, a CartesianGrid or an Octree, got 'file.vtu'"):
        check_type("on", "file.vtu", SimplexMesh, CartesianGrid, Octree)


def test_whole_numbers_and_slopes_have_an_upper_end():
    assert as_whole_number("n", 1000.0, lower=0, upper=1000) == 1000
    with message("n must be at most 1000, got 1001"):
        as_whole_number("n", 1001, lower=0, upper=1000)
    with message("n must be a whole number, got 0.5"):
        as_whole_number("n", 0.5, lower=0, upper=1000)
    assert as_slope("g", 1e30) == 1e30
    with message("g must be at most 1e+30, got 1e+300"):
        as_slope("g", 1e300)


def test_numbers_are_in_a_range_in_which_they_can_be_squared():
    for number in (0.0, 1e-60, 1e60, np.inf):
        assert as_number("h", number, lower=0.0, allow_inf=True) == number
    with message("h must be at least 1e-60, got 4.94066e-324"):
        as_number("h", 5e-324, lower=0.0)
    with message("h must be at most 1e+60, got 1e+155"):
        as_number("h", 1e155, lower=0.0)
