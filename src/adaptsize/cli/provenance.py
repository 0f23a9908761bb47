"""The command that made a file, for the record beside it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from adaptsize._records import facts_of, sha256
from adaptsize.options import Option


@dataclass(frozen=True)
class TypedCommand:
    """A command as it was given, without general options and outputs."""

    words: tuple[str, ...]
    """The name of the command, the file that it reads, and options."""
    inputs: dict[str, str] = field(default_factory=dict)
    """SHA-256 of each file that it reads, by its path as typed."""

    @classmethod
    def of(
        cls, name: str, file: Path, typed: Mapping[str, Any], options: Mapping[str, Option]
    ) -> TypedCommand:
        """Return the request with options as they were typed.

        Pictures and pages are left out.
        """
        words, inputs = [name, str(file)], [file]
        for key, value in typed.items():
            option = options[key]
            is_file = option.type is Path
            if writes_file(option):
                continue
            for one in value if isinstance(value, list) else [value]:
                if one is None or one is False:
                    continue
                words += [option.flags[-1]] + ([] if one is True else [typed_text(one)])
                inputs += [Path(one)] if is_file else list(_files_in(key, str(one)))
        return cls(tuple(words), {str(path): sha256(path) for path in inputs if path.is_file()})

    def at(self, places: Mapping[str, Path]) -> list[str]:
        """Return the words with other paths of the inputs."""
        found = list(self.words)
        for path, place in places.items():
            for k, word in enumerate(found):
                if word == path:
                    found[k] = str(place)
                elif word.startswith(f"curve:{path}="):
                    found[k] = word.replace(path, str(place), 1)
        return found


def typed_text(value: Any) -> str:
    """Return a value as it would be typed: whole numbers without a fraction."""
    is_whole = isinstance(value, float) and value.is_integer() and abs(value) < 1e15
    return str(int(value) if is_whole else value)


def writes_file(option: Option) -> bool:
    """Return whether an option names a file to write, such as a picture or a page."""
    return option.group == "Output" and option.type is Path


def _files_in(name: str, text: str) -> Iterable[Path]:
    """Yield the file that the text of an option names, if it does."""
    if name == "source" and text.startswith("curve:"):
        yield Path(text.rpartition("=")[0].removeprefix("curve:"))
    elif name == "metric":
        yield Path(text)


def provenance_of(path: Path, request: TypedCommand) -> dict[str, Any]:
    """Return what is stored beside a file that a command has written, plain values."""
    return facts_of(path, request.inputs) | {
        "command": list(request.words),
        "input": request.words[1],
    }
