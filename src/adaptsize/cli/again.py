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

from adaptsize import _calls
from adaptsize._checks import refusal
from adaptsize._formats.guards import write_whole
from adaptsize._records import description, read_record, sha256, versions
from adaptsize.cli.command import command
from adaptsize.cli.console import Console
from adaptsize.cli.options import Given, own
from adaptsize.cli.provenance import TypedCommand

#: The record, as an argument.
Record = Annotated[
    Path, typer.Argument(metavar="NAME.json", help="The record beside a file, or that file.")
]
_KEYS = {"inputs", "sha256", "version", "input", "date", "folder"}


@command(own("Output", "output", Path, "Keep the new file under this name.", short="-o"))
def again(console: Console, file: Record, given: Given) -> int:
    """Make a file again from the record beside it, and compare the two bit for bit.

    Inputs must be what they were.  The exit code is 1 if the new file differs.
    """
    made = file.with_suffix("") if file.suffix == ".json" else file
    record, output = read_record(made), given.get("output")
    if not record.keys() >= _KEYS or not record.keys() & {"command", "calls"}:
        raise ValueError(f"{file}: there is no record of adaptsize beside {made.name}")
    if output is not None and output.exists():
        raise refusal("output", f"must be a new file, {output} exists")
    if output is not None and not output.parent.is_dir():
        raise ValueError(f"{output}: there is no directory {output.parent}")
    folder_of_inputs = _folder_with(record)
    console.say(f"{made.name}: {description(record)}")
    with tempfile.TemporaryDirectory() as folder:
        new = Path(folder) / made.name
        if "calls" in record:
            _call(record, folder_of_inputs, new)
        else:
            request = TypedCommand(tuple(record["command"]), record["inputs"])
            words = request.at(folder_of_inputs)
            _run([*words, "-o", str(Path(folder) / _name_of_output(request, made))], console)
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


def _folder_with(record: Mapping[str, Any]) -> Path:
    """Return the folder in which all inputs are what they were: this one, or that of the record."""
    if record.get("unknown"):
        raise ValueError(f"the record does not hold all: {'; '.join(record['unknown'])}")
    faults = []
    for folder in (Path(), Path(record["folder"])):
        wrong = [
            f"{path} is {'not what it was' if (folder / path).is_file() else 'missing'}"
            for path, known in record["inputs"].items()
            if not (folder / path).is_file() or sha256(folder / path) != known
        ]
        if not wrong:
            return folder
        faults.append(wrong[0])
    raise ValueError(f"the inputs must be those of the record: {faults[0]}")


def _call(record: Mapping[str, Any], folder: Path, new: Path) -> None:
    """Make the calls of a record of Python code, with inputs from a folder; write the new file."""
    steps = [*record["calls"]]
    last = {**steps[-1]["arguments"], "path": str(new)}
    steps[-1] = {**steps[-1], "arguments": last}
    _calls.repeated(steps, {path: str(folder / path) for path in record["inputs"]})


def _name_of_output(request: TypedCommand, made: Path) -> str:
    """Return the name that the command got: ``family`` writes NAME-1.vtu for NAME.vtu."""
    if request.words[0] == "family":
        return made.stem.rpartition("-")[0] + made.suffix
    return made.with_suffix(".mesh").name if made.suffix == ".sol" else made.name


def _run(words: list[str], console: Console) -> None:
    """Run a command; what it prints are messages of this one."""
    from typer.main import get_command

    from adaptsize.cli.commands import app

    general = ["--quiet"] if console.quiet or console.as_json else []
    general += ["--verbose"] if console.verbose else []
    with contextlib.redirect_stdout(sys.stderr):
        get_command(app).main(
            [*words, *general], prog_name="adaptsize", standalone_mode=False, obj=Console()
        )


def _changed(record: Mapping[str, Any]) -> list[str]:
    """Return the versions of the record that differ from the present ones."""
    from adaptsize import __version__

    now = {"adaptsize": __version__, **versions()}
    then = {"adaptsize": record["version"], **record.get("versions", {})}
    return [f"{name} {version}" for name, version in then.items() if now.get(name) != version]
