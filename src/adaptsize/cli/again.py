"""``adaptsize again``: make a file again from its record, and compare it."""

from __future__ import annotations

import contextlib
import shutil
import sys
import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from adaptsize import _repeating
from adaptsize._checks import refusal
from adaptsize._formats.guards import write_whole
from adaptsize._records import (
    description,
    fault_of,
    read_record,
    record_beside,
    sha256,
    versions,
)
from adaptsize.cli.command import command
from adaptsize.cli.console import Console
from adaptsize.cli.options import Given, own
from adaptsize.cli.provenance import TypedCommand

#: The record, as an argument.
Record = Annotated[
    Path, typer.Argument(metavar="NAME.json", help="The record beside a file, or that file.")
]
_KEYS = {"inputs", "sha256", "version", "input", "date", "folder"}
#: Commands that write a file with a record.
_RECORDED = ("remesh", "size", "limit", "family", "adapt", "image")


@command(own("Output", "output", Path, "Keep the new file under this name.", short="-o"))
def again(console: Console, file: Record, given: Given) -> int:
    """Make a file again from the record beside it, and compare the two bit for bit.

    Inputs must be what they were.  The exit code is 1 if the new file differs.  No other files are
    written, whatever the record says.
    """
    made = file.with_suffix("") if file.suffix == ".json" else file
    record, output = read_record(made), given.get("output")
    if not record.keys() >= _KEYS or not record.keys() & {"command", "calls"}:
        beside = record_beside(made)
        if beside.exists():
            raise ValueError(f"{beside}: is no record of adaptsize, or a damaged one")
        raise ValueError(f"{file}: there is no record of adaptsize beside {made.name}")
    fault = fault_of(record) or _fault_of_command(record)
    if fault:
        raise ValueError(f"{record_beside(made)}: the record is damaged: {fault}")
    if output is not None and output.exists():
        raise refusal("output", f"must be a new file, {output} exists")
    if output is not None and not output.parent.is_dir():
        raise ValueError(f"{output}: there is no directory {output.parent}")
    places = _places_of_inputs(record)
    console.say(f"{made.name}: {description(record)}")
    with tempfile.TemporaryDirectory() as folder:
        new = Path(folder) / made.name
        try:
            if "calls" in record:
                _call(record, places, new)
            else:
                _run(record, places, made, Path(folder), console)
        except (_repeating.UnknownError, RecursionError) as error:
            raise ValueError(f"{record_beside(made)}: {error}") from error
        if not new.is_file():
            raise ValueError(f"{file}: the command has not written {made.name}")
        is_same = sha256(new) == record["sha256"]
        if output is not None:
            write_whole(output, partial(shutil.copyfile, new))
    changed = _changed(record)
    console.record(same=is_same, made_with=record.get("versions", {}), made_by=record["version"])
    if is_same:
        console.print(f"{made.name}: the same, bit for bit")
        return 0
    cause = f" (then {', '.join(changed)})" if changed else ", with the same versions of packages"
    console.print(f"{made.name}: another file{cause}")
    return 1


def _fault_of_command(record: Mapping[str, Any]) -> str:
    """Return why the command of a record is not run; empty if there is none, or no reason."""
    word = record.get("command", _RECORDED)[0]
    return "" if word in _RECORDED else f"{word} is no command that writes a record"


def _places_of_inputs(record: Mapping[str, Any]) -> dict[str, Path]:
    """Return where the inputs are what they were.

    That is in this folder, in that of the record, or where they were read.
    """
    if record.get("unknown"):
        raise ValueError(f"the record does not hold all: {'; '.join(record['unknown'])}")
    found = {}
    for path, known in record["inputs"].items():
        places = [Path(path), Path(record["folder"], path)]
        places += [Path(place) for name, place in record.get("places", {}).items() if name == path]
        files = [place for place in places if place.is_file()]
        same = [place for place in files if sha256(place) == known]
        if not same:
            text = f"{path} is {'not what it was' if files else 'missing'}"
            raise ValueError(f"the inputs must be those of the record: {text}")
        found[path] = same[0].absolute()
    return found


def _call(record: Mapping[str, Any], places: Mapping[str, Path], new: Path) -> None:
    """Make the calls of a record of Python code, with inputs at their places, and write."""
    steps = [*record["calls"]]
    if steps[-1]["function"] != "write":
        raise _repeating.UnknownError("the last call must be that of write")
    last = {**steps[-1]["arguments"], "path": str(new)}
    steps[-1] = {**steps[-1], "arguments": last}
    _repeating.repeated(steps, {path: str(place) for path, place in places.items()})


def _name_of_output(request: TypedCommand, made: Path) -> str:
    """Return the name that the command got: ``family`` writes NAME-1.vtu for NAME.vtu."""
    if request.words[0] == "family":
        return made.stem.rpartition("-")[0] + made.suffix
    return made.with_suffix(".mesh").name if made.suffix == ".sol" else made.name


def _run(
    record: Mapping[str, Any],
    places: Mapping[str, Path],
    made: Path,
    folder: Path,
    console: Console,
) -> None:
    """Run the command of a record; what it prints are messages of this one."""
    from typer.main import get_command

    from adaptsize.cli.commands import app

    request = TypedCommand(tuple(record["command"]), record["inputs"])
    output = folder / _name_of_output(request, made)
    general = ["--quiet"] if console.quiet or console.as_json else []
    general += ["--verbose"] if console.verbose else []
    with contextlib.redirect_stdout(sys.stderr):
        get_command(app).main(
            [*request.at(places), "-o", str(output), *general],
            prog_name="adaptsize",
            standalone_mode=False,
            obj=Console(only=output),
        )


def _changed(record: Mapping[str, Any]) -> list[str]:
    """Return the versions of the record that differ from the present ones."""
    from adaptsize import __version__

    now = {"adaptsize": __version__, **versions()}
    then = {"adaptsize": record["version"], **record.get("versions", {})}
    return [f"{name} {version}" for name, version in then.items() if now.get(name) != version]
