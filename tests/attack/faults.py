"""Faults around adaptsize: signals, a full disk, closed pipes, a damaged cache, interruptions.

Every program is started with a mark in its environment.  The processes that it leaves behind are
found by that mark, and only those are ended.
"""

import contextlib
import os
import re
import resource
import secrets
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from backgrounds import active_nodes

import adaptsize as ads

from .cases import LONGEST, Failure, told_with
from .world import any_background, make

_MARK = "ADAPTSIZE_ATTACK"
_BEFORE = b"the file that was here before"
#: Seconds after which a program counts as hanging; many times what it takes on a busy machine.
_PATIENCE = 900.0


class Fault(NamedTuple):
    """What is done to a command."""

    what: str
    options: dict[str, Any] | None = None
    """Of `subprocess.Popen`."""
    send: tuple[signal.Signals, float] | None = None
    """A signal, and the seconds until then."""
    codes: tuple[int, ...] | None = None
    """Exit codes allowed besides that of a run without a fault; None: all."""


def run(rng: np.random.Generator, folder: Path) -> str:
    """Run a random fault."""
    name = str(rng.choice([*_FAULTS, "signal", "two at once", "interrupted call"]))
    if name == "interrupted call":
        return f"{name}: {_interrupted_call(rng)}"
    arguments, output, code = _command(rng, folder)
    is_pair = name == "two at once"
    fault = Fault("", codes=()) if is_pair else _FAULTS[name](rng, folder)
    what = f"{name} {fault.what}, {arguments}"
    with told_with(what):
        programs = [
            _Program(folder, arguments, **(fault.options or {})) for _ in range(1 + is_pair)
        ]
        if fault.send:
            programs[0].send(*fault.send)
        for program in programs:
            found, errors = program.finish()
            what += f", exit {found}"
            check_errors(errors)
            if fault.codes is not None and found not in (code, *fault.codes):
                raise Failure(f"exit {found}, {errors[-200:]}")
            if found == 0 and output and (folder / output).read_bytes() == _BEFORE:
                raise Failure("nothing was written")
            _check_files(folder, output, program.scratch, found == -signal.SIGKILL)
    return what


class _Program:
    """A command of adaptsize in a folder with temporary files of its own."""

    def __init__(self, folder: Path, arguments: str, **options: Any) -> None:
        self.mark = secrets.token_hex(8)
        self.scratch = folder / f"tmp-{self.mark}"
        self.scratch.mkdir()
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
        own = {_MARK: self.mark, "TMPDIR": str(self.scratch)}
        options |= {"cwd": folder, "env": os.environ | own | options.get("env", {})}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "adaptsize", *arguments.split()],
            stdin=subprocess.DEVNULL, start_new_session=True, **options,
        )  # fmt: skip

    def send(self, number: signal.Signals, after: float) -> None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(after)
        self.process.send_signal(number)

    def finish(self) -> tuple[int, str]:
        """Wait for the end; return the exit code and what was printed to standard error."""
        try:
            errors = self.process.communicate(timeout=_PATIENCE)[1]
        except subprocess.TimeoutExpired:
            raise Failure(f"no end after {_PATIENCE:g} s") from None
        finally:
            left = self._end_others()
        if left:
            raise Failure(f"left behind: {'; '.join(left)}")
        return self.process.returncode, (errors or b"").decode("utf-8", "replace")

    def _end_others(self) -> list[str]:
        """End the processes that still run after a while, and return their command lines."""
        until = time.monotonic() + 3.0
        while (found := _marked(self.mark)) and time.monotonic() < until:
            time.sleep(0.1)
        for pid in found:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()
        return list(found.values())


def _marked(mark: str) -> dict[int, str]:
    """Return the processes that carry a mark, and their command lines."""
    found = {}
    for place in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            # Of a process that has ended nothing can be read.
            if f"{_MARK}={mark}".encode() in (place / "environ").read_bytes().split(b"\0"):
                line = (place / "cmdline").read_bytes().replace(b"\0", b" ")
                found[int(place.name)] = line.decode("utf-8", "replace")[:100]
    return found


def _command(rng: np.random.Generator, folder: Path) -> tuple[str, str | None, int]:
    """Return a random command on a small surface, its output, and its code without a fault."""
    sphere = make("grid 3-D", rng).boundary
    field = np.full(sphere.n_points, 0.2)
    field[0] = 0.05
    ads.write(folder / "part.vtu", sphere, fields={"h0": field, "h": field})
    writing = (
        "limit part.vtu -g 0.3 --field h0 -o out.vtu",
        "size part.vtu -o out.vtu",
        "remesh part.vtu --hmax 0.3 -o out.vtu",
        "remesh part.vtu --hmax 0.3 -o out.mesh",
    )
    # The edges of the part are not as long as its sizes, so that the check fails.
    at = int(rng.integers(0, 6))
    if at >= 4:
        return ("info part.vtu", "check part.vtu")[at - 4], None, at - 4
    output = writing[at].split()[-1]
    if rng.random() < 0.5:
        (folder / output).write_bytes(_BEFORE)
    return writing[at], output, 0


def _check_files(folder: Path, output: str | None, scratch: Path, is_killed: bool) -> None:
    """Raise a `Failure` if the output is neither whole nor as before, or other files are left."""
    left = [p.name for p in folder.iterdir() if p.name.startswith((".", "adaptsize-"))]
    left += [path.name for path in scratch.iterdir()]
    if left and not is_killed:
        raise Failure(f"unfinished or temporary files are left: {left}")
    path = folder / (output or "")
    if path.is_file() and path.read_bytes() != _BEFORE:
        try:
            ads.read(path)
        except ValueError as error:
            raise Failure(f"an output that is not whole, {error}") from error


def check_errors(errors: str) -> None:
    """Raise a `Failure` for a traceback or a long message."""
    if "Traceback" in errors and not _interrupts_the_start(errors):
        raise Failure(f"a traceback, {errors[-300:]!r}")
    if any(len(line) > LONGEST for line in errors.splitlines()):
        raise Failure(f"a message of more than {LONGEST} characters")


def _interrupts_the_start(errors: str) -> bool:
    """Whether Ctrl-C came before the command's own code, which is Python's to report."""
    files = set(re.findall(r'File "[^"]*/adaptsize/(.*?)"', errors))
    return errors.rstrip().endswith("KeyboardInterrupt") and files <= {"__init__.py", "_lazy.py"}


# --- faults ---------------------------------------------------------------------------------------


def _signal(rng: np.random.Generator, folder: Path) -> Fault:
    names = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL]
    number = signal.Signals(rng.choice(names))
    after = float(rng.choice([0.3, 1.0, 3.0, 8.0]) * rng.random())
    return Fault(f"{number.name} after {after:.2f} s", send=(number, after))


def _disk_full(rng: np.random.Generator, folder: Path) -> Fault:
    room = int(rng.choice([0, 10, 500, 3000, 20_000, 100_000]) * rng.random())

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    return Fault(f"after {room} bytes", {"preexec_fn": limit}, codes=(0, 1))


def _closed_pipes(rng: np.random.Generator, folder: Path) -> Fault:
    which = str(rng.choice(["stdout", "stderr", "both", "reader gone"]))
    if which == "reader gone":
        reader, writer = os.pipe()
        os.close(reader)
        return Fault(which, {"stdout": os.fdopen(writer, "wb")})

    def close() -> None:
        for number in {"stdout": [1], "stderr": [2]}.get(which, [1, 2]):
            os.close(number)

    return Fault(which, {"preexec_fn": close})


def _damaged_cache(rng: np.random.Generator, folder: Path) -> Fault:
    kernels, cache = os.environ.get("NUMBA_CACHE_DIR"), folder / "cache"
    if kernels and Path(kernels).is_dir():
        shutil.copytree(kernels, cache, ignore=shutil.ignore_patterns("bounds"))
    files = sorted(path for path in cache.rglob("*.nb?") if path.is_file())
    for path in files:
        if rng.random() >= 0.3:
            continue
        data = path.read_bytes()
        cut = int(rng.integers(0, len(data) + 1))
        damage = str(rng.choice(["empty", "cut", "noise", "gone"]))
        if damage == "noise" and path.suffix == ".nbi":
            path.write_bytes(data[:cut] + rng.bytes(20) + data[cut + 20 :])
        elif damage == "gone":
            path.unlink()
        else:
            path.write_bytes(data[: 0 if damage == "empty" else cut])
    return Fault(f"of {len(files)} files", {"env": {"NUMBA_CACHE_DIR": str(cache)}}, codes=())


_FAULTS: dict[str, Callable[[np.random.Generator, Path], Fault]] = {
    "signal": _signal,
    "disk full": _disk_full,
    "closed pipes": _closed_pipes,
    "damaged cache": _damaged_cache,
}


def _interrupted_call(rng: np.random.Generator) -> str:
    """Interrupt a call in the middle, then repeat it: the result must be that of a new process."""
    background = any_background(rng)
    h0 = np.full(background.nodal_shape, np.inf)
    h0.flat[int(np.flatnonzero(active_nodes(background))[0])] = 0.1
    expected = ads.limit_gradient(background, h0, 0.3)
    left = iter(range(int(rng.integers(0, 4))))

    def stop(text: str, share: float | None) -> None:
        if next(left, None) is None:
            raise KeyboardInterrupt

    with contextlib.suppress(KeyboardInterrupt):
        ads.limit_gradient(background, h0, 0.3, progress=stop)
    if not np.array_equal(ads.limit_gradient(background, h0, 0.3), expected):
        raise Failure(f"another result after an interruption on {background!r}")
    return repr(background)
