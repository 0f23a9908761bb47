"""Deprecated names work, and the warning points at the caller."""

import inspect

import pytest

from adaptsize._deprecation import renamed_argument, warn_deprecated


@renamed_argument("gradation", "g", "0.4")
def growth(h, *, g=0.25):
    """Return the next size."""
    return h * (1.0 + g)


def test_the_old_keyword_works_with_a_warning_at_the_caller():
    match = r"growth\(gradation=\) is deprecated and will be removed in adaptsize 0.4: use g="
    with pytest.warns(DeprecationWarning, match=match) as caught:
        assert growth(2.0, gradation=0.5) == 3.0
    assert caught[0].filename == __file__
    assert growth(2.0, g=0.5) == 3.0  # warnings are errors here


def test_both_names_are_refused_and_the_signature_has_the_new_one():
    with pytest.raises(TypeError, match="gradation is the old name of g"):
        growth(2.0, g=0.5, gradation=0.5)
    assert list(inspect.signature(growth).parameters) == ["h", "g"]


def test_a_deprecated_function_names_its_replacement_at_the_caller():
    def grade():
        warn_deprecated("grade", "limit_gradient", "0.4")

    with pytest.warns(DeprecationWarning, match="use limit_gradient") as caught:
        grade()
    assert caught[0].filename == __file__
