"""Deprecated names and arguments: they work for one more minor release, with a warning."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def warn_deprecated(old: str, new: str, removed_in: str, *, stacklevel: int = 2) -> None:
    """Warn of a deprecated name, at the line that calls the calling function.

    Parameters
    ----------
    old, new : str
        The deprecated name and its replacement.
    removed_in : str
        The release that removes it, such as ``"0.4"``.
    stacklevel : int
        1 names the line that calls this function.

    Warns
    -----
    DeprecationWarning

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     warn_deprecated("grade", "limit_gradient", "0.4")
    >>> print(caught[0].message)
    grade is deprecated and will be removed in adaptsize 0.4: use limit_gradient
    """
    warnings.warn(
        f"{old} is deprecated and will be removed in adaptsize {removed_in}: use {new}",
        DeprecationWarning,
        stacklevel=stacklevel + 1,
    )


def renamed_argument(
    old: str, new: str, removed_in: str
) -> Callable[[Callable[_Arguments, _Result]], Callable[_Arguments, _Result]]:
    """Return a decorator that still accepts the keyword ``old`` for ``new``.

    The signature of the function shows the new name only.

    Parameters
    ----------
    old, new, removed_in : str
        As in `warn_deprecated`.

    Examples
    --------
    >>> @renamed_argument("gradation", "g", "0.4")
    ... def growth(g):
    ...     return 1.0 + g
    >>> growth(g=0.5)
    1.5
    """

    def decorate(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
        @functools.wraps(function)
        def accepting(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
            given: dict[str, Any] = kwargs
            if old in given:
                if new in given:
                    raise TypeError(f"{function.__name__}: {old} is the old name of {new}; omit it")
                warn_deprecated(f"{function.__name__}({old}=)", f"{new}=", removed_in)
                given[new] = given.pop(old)
            return function(*args, **kwargs)

        return accepting

    return decorate
