"""The check of what is given for the options of a record."""

from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from difflib import get_close_matches
from typing import Any, TypeVar, cast

from adaptsize._checks import refusal
from adaptsize._messages import Message
from adaptsize.errors import OptionError
from adaptsize.options.entrances import DOMAINS, ENTRANCES, entrances_with
from adaptsize.options.records import options_of
from adaptsize.options.sizes import SizeFunctionOptions

R = TypeVar("R")


#: Values that request nothing, so that they may be given where an option is not implemented.
_OFF = {"elements_between": 0.0, "tolerance": float("inf")}


def refuse_unused(kind: str, given: Mapping[str, Any], what: str) -> None:
    """Refuse options of `size_function` that do not apply to a kind of domain.

    Parameters
    ----------
    kind : str
        One of `DOMAINS`.
    given : mapping
        What the user gives.
    what : str
        The domain, in words.

    Raises
    ------
    OptionError
        With the kinds of domains that have the option.
    """
    used, every = options_of(DOMAINS[kind]), options_of(SizeFunctionOptions)
    for name, value in given.items():
        is_off = value is None or (name in _OFF and value == _OFF[name])
        if name in every and name not in used and not is_off:
            having = entrances_with(name, DOMAINS)
            raise refusal(name, f"applies to {having}, got it with {what}")


def checked(record: type[R], given: Mapping[str, Any]) -> R:
    """Return the options of a record, checked; those that are not given have their defaults.

    ``growth`` is returned as ``g``.

    Raises
    ------
    TypeError
        If the record has no option of a given name.  The message has the closest name.
    ValueError
        If a value is out of range.
    """
    options = options_of(record)  # type: ignore[arg-type]
    for name in given:
        if name not in options:
            close = get_close_matches(name, options, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(options)}"
            having = entrances_with(name, ENTRANCES)
            if having:
                hint = f"it is of {having}"
            raise TypeError(f"unexpected option {name!r}: {hint}")
    values = {
        name: option.check(given.get(name, option.default)) for name, option in options.items()
    }
    growth = values.pop("growth", None)
    if growth is not None:  # another name of g
        if values["g"] is not None:
            raise OptionError(Message("{growth} and {g} exclude each other: {growth} is 1 + {g}"))
        limit = float(Decimal(repr(growth)) - 1)  # 1.2 is 0.2 to the last bit
        values["g"] = replace(options["g"], of_sizes=False).check(limit)
    return cast(R, values)
