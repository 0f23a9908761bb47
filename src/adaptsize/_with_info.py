"""Functions that also have diagnostics: ``f(...)`` is the result, ``f.with_info(...)`` a pair."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, Protocol, TypeVar

P = ParamSpec("P")
R_co = TypeVar("R_co", covariant=True)
I_co = TypeVar("I_co", covariant=True)


class WithInfo(Protocol[P, R_co, I_co]):
    """A function with an attribute `with_info`, which takes the same arguments."""

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R_co:
        """Return the result."""
        ...

    @property
    def with_info(self) -> Callable[P, tuple[R_co, I_co]]:
        """Return the result and the info."""
        ...


def with_info(function: Callable[P, tuple[R_co, I_co]]) -> WithInfo[P, R_co, I_co]:
    """Return a function that returns the first item of the pair ``(result, info)`` only.

    Its attribute ``with_info`` returns the pair.  Both add one frame to the stack, which counts for
    the ``stacklevel`` of warnings.

    Parameters
    ----------
    function : callable
        Annotated to return ``tuple[Result, Info]``.  If it has a parameter ``wants_info``, which
        users do not see, this is False where the info is dropped.
    """
    signature = inspect.signature(function)
    without: Callable[..., tuple[R_co, I_co]] = function
    if "wants_info" in signature.parameters:
        without = functools.partial(without, wants_info=False)
    shown = [p for name, p in signature.parameters.items() if name != "wants_info"]
    signature = signature.replace(parameters=shown)
    first = signature.return_annotation.removeprefix("tuple[").split(",")[0]

    @functools.wraps(function)
    def result_only(*args: P.args, **kwargs: P.kwargs) -> R_co:
        return without(*args, **kwargs)[0]

    @functools.wraps(function)
    def both(*args: P.args, **kwargs: P.kwargs) -> tuple[R_co, I_co]:
        return function(*args, **kwargs)

    # Functions may have attributes, but their type does not say so.
    plain: Any = result_only
    pair: Any = both
    name = function.__name__
    pair.__doc__ = f"Return the pair ``(result, info)``; takes the arguments of `{name}`."
    pair.__qualname__ = f"{function.__qualname__}.with_info"
    pair.__signature__ = signature
    plain.with_info = pair
    plain.__annotations__ = {**function.__annotations__, "return": first}
    plain.__signature__ = signature.replace(return_annotation=first)
    decorated: WithInfo[P, R_co, I_co] = plain
    return decorated
