"""The declaration of an option: default, range, unit and text, and the check of a value."""

import inspect
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin

from adaptsize._checks import (
    as_flag,
    as_number,
    as_slope,
    as_whole_number,
    one_of,
    warn_caller,
    were_checked,
)
from adaptsize._messages import Message
from adaptsize.errors import InputWarning

#: Gradient limits from this on look like percentages.
_PERCENTAGE = 10.0


@dataclass(frozen=True)
class Option:
    """The declaration of an option.

    What is not given here is that of the annotated type: whether None is allowed, and the choices
    of a ``Literal``.  The text is in the docstring of the record.  Values of other types than
    numbers, flags and choices are checked where they are used.
    """

    default: object = None
    chosen: str = ""
    """The default in words, if it depends on the other arguments."""
    unit: Literal["", "length", "degrees", "seconds", "pixels"] = ""
    lower: float = 0.0
    above: bool = False
    """Whether ``lower`` itself is refused."""
    upper: float | None = None
    inf: bool = False
    """Whether inf is allowed."""
    is_slope: bool = False
    """Whether this is a gradient limit; a number that looks like a percentage is warned of."""
    of_sizes: bool = False
    """Whether it is one of sizes, where a number from 1 to 2 looks like a growth ratio."""
    type_text: str = ""
    """The type in words, if it is not a number, a flag or one of some choices."""
    short: str = ""
    """The short name on the command line."""
    text: str = ""
    """What it is: the first sentence in the docstring; also the help of the command line."""
    details: str = ""
    """Further sentences, for docstrings of functions only."""
    # The following are those of the field, set by `options_of`.
    name: str = ""
    type: Any = None
    """Without None."""
    optional: bool = False
    """Whether None is allowed."""
    group: str = ""
    """Title of the record that declares it."""

    @property
    def flags(self) -> tuple[str, ...]:
        """Names on the command line, the short one first."""
        long = "--" + self.name.replace("_", "-")
        return (self.short, long) if self.short else (long,)

    @property
    def metavar(self) -> str:
        """What stands for the value on the command line."""
        if self.unit:
            return self.unit.upper()
        return "N" if self.type in (float, int) else "NAME"

    @property
    def choices(self) -> tuple[str, ...]:
        """The values of a ``Literal``, else none."""
        return get_args(self.type) if get_origin(self.type) is Literal else ()

    @property
    def help(self) -> str:
        """The text with the default, if there is one, for the command line."""
        default = self.chosen or ("" if self.default is None else f"{self.default}")
        if self.type is bool or not default:
            return self.text
        return f"{self.text}  [{default.removesuffix('.0')}]"

    def check(self, value: Any) -> Any:
        """Return a value in the type of the option, after checking it."""
        if value is None and self.optional:
            return None
        if self.type is bool:
            return as_flag(self.name, value)
        if self.choices:
            return one_of(self.name, value, self.choices, or_none=self.optional)
        if self.type is int:
            upper = 2**53 if self.upper is None else int(self.upper)
            return as_whole_number(self.name, value, lower=int(self.lower), upper=upper)
        if self.is_slope and (self.type is float or isinstance(value, float | int)):
            value = as_slope(self.name, value)
        elif self.type is float:
            unit = self.unit if self.unit == "degrees" else ""
            value = as_number(
                self.name, value, lower=self.lower, strict=self.above, allow_inf=self.inf,
                upper=self.upper, unit=unit,
            )  # fmt: skip
        if not were_checked():
            self._warn_of(value)
        return value

    def _warn_of(self, value: Any) -> None:
        """Warn of a gradient that looks like a growth ratio or a percentage."""
        if self.of_sizes and isinstance(value, float | int) and 1.0 < value < 2.0:
            text = (
                "{} = {:g} lets sizes grow by {:g} per length; a growth ratio of {:g} from an "
                "element to the next is {} = {:.4g}"
            )
            name = Message.name(self.name)
            warn_caller(Message(text, name, value, value, value, name, value - 1.0), InputWarning)
        if self.is_slope and isinstance(value, float | int) and value >= _PERCENTAGE:
            text = (
                f"= {value:g} hardly limits anything: it is a gradient, not a percentage; 0.25 "
                "lets neighbouring edges differ by about a quarter"
            )
            warn_caller(Message.about(self.name, text), InputWarning)

    def as_parameter(self) -> inspect.Parameter:
        """Return the parameter of a function."""
        kind = self.type_text or (self.type | None if self.optional else self.type)
        return inspect.Parameter(
            self.name, inspect.Parameter.KEYWORD_ONLY, default=self.default, annotation=kind
        )

    @property
    def doc(self) -> tuple[str, str]:
        """Type and default, and the text, for the docstring of a function."""
        listed = ", ".join(f'"{choice}"' for choice in self.choices)
        kind = self.type_text or (f"{{{listed}}}" if listed else self.type.__name__)
        default, chosen = f"default {self.default}", self.chosen
        if isinstance(self.default, float):
            default = f"default {self.default:.10g}"
        elif self.default is None:
            default = "optional"
        if chosen and len(kind + chosen) < 64:
            default, chosen = f"default {chosen}", ""
        last = f"The default is {chosen}." if chosen else ""
        text = "  ".join(part for part in (self.text, self.details, last) if part)
        return f"{kind}, {default}", text
