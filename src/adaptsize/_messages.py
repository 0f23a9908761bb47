"""Messages that name options, which have other names on the command line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from string import Formatter
from typing import Any, NamedTuple


class Named(NamedTuple):
    """An option in a message, alone or with a value to give it."""

    option: str
    value: str = ""

    def __str__(self) -> str:
        """Return it as in Python."""
        return f"{self.option}={self.value}" if self.value else self.option

    def typed(self, flags: Mapping[str, str]) -> str:
        """Return it as on the command line, or as in Python if it is no option there."""
        if self.option not in flags:
            return str(self)
        value = "" if self.value == "True" else f" {self.value}".rstrip()
        return flags[self.option] + value.replace("'", "")


class Message(str):
    """A text that names options.

    It is the text as in Python.  The command line replaces the names, and an `OptionError` has
    them.

    Parameters
    ----------
    template : str
        As for `str.format`: the names of options stand in braces, and other values are those that
        follow.  A value for an option is its format.
    *values : object
        Also messages, whose options are named too.

    Examples
    --------
    >>> text = Message("{hmin} must be at most {hmax} = {:g}, got {:g}", 1.0, 2.0)
    >>> text
    'hmin must be at most hmax = 1, got 2'
    >>> text.typed({"hmin": "--hmin", "hmax": "--hmax"})
    '--hmin must be at most --hmax = 1, got 2'
    >>> text.options
    ('hmin', 'hmax')
    >>> text = Message("{}; pass {strict:True} or {target:'triangles'}", "the surface is open")
    >>> text
    "the surface is open; pass strict=True or target='triangles'"
    >>> text.typed({"strict": "--strict", "target": "--target"})
    'the surface is open; pass --strict or --target triangles'
    """

    _parts: tuple[str | Named, ...]

    def __new__(cls, template: str, *values: object) -> Message:
        return cls._of(_parts_of(template, iter(values)))

    @classmethod
    def about(cls, name: str, text: str) -> Message:
        """Return a message that begins with the name of an option, or of an entry of it."""
        option, bracket, entry = name.partition("[")
        return cls("{}{}{} {}", cls.name(option), bracket, entry, text)

    @classmethod
    def name(cls, option: str, value: str = "") -> Message:
        """Return the name of an option, alone or with a value to give it."""
        return cls._of([Named(option, value)])

    @classmethod
    def joined(cls, separator: str, texts: Iterable[str]) -> Message:
        """Return messages, or other texts, with a text between them."""
        several = list(texts)
        return cls(separator.join(["{}"] * len(several)), *several)

    @classmethod
    def _of(cls, parts: Iterable[str | Named]) -> Message:
        kept = tuple(parts)
        message = super().__new__(cls, "".join(map(str, kept)))
        message._parts = kept
        return message

    def __reduce__(self) -> tuple[Callable[..., Message], tuple[Any, ...]]:
        return Message._of, (self._parts,)

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options, each once, in the order of the text."""
        named = (part.option for part in self._parts if isinstance(part, Named))
        return tuple(dict.fromkeys(named))

    def typed(self, flags: Mapping[str, str]) -> str:
        """Return the text with the names that options have on the command line.

        Parameters
        ----------
        flags : mapping of str to str
            What is typed for each option.
        """
        return "".join(p if isinstance(p, str) else p.typed(flags) for p in self._parts)


def _parts_of(template: str, values: Iterator[object]) -> Iterable[str | Named]:
    """Yield the texts and the options of a template."""
    for text, field, form, conversion in Formatter().parse(template):
        if text:
            yield text
        if field is None:
            continue
        if field:
            yield Named(field, form.format(next(values)) if form and "{" in form else form or "")
            continue
        value = next(values)
        if isinstance(value, Message):
            yield from value._parts
        else:
            yield format(repr(value) if conversion == "r" else value, form or "")


def message_of(error: BaseException) -> str:
    """Return the text of an error or a warning, which is a `Message` if it names options."""
    first = error.args[0] if error.args else None
    return first if isinstance(first, Message) else str(error)
