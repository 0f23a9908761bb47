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

import adaptsize as ads

from .cases import Failure
from .world import any_background, make

_MARK = "ADAPTSIZE_ATTACK"
_BEFORE = b"the file that was here before"
_LONGEST = 1000
#: Seconds after which a program counts as hanging; many times what it takes on a busy machine.
_PATIENCE = 900.0


class Fault(NamedTuple):
    """What is done to a command."""

    what: str
    options: dict[str, Any] | None = None
    """Of `subprocess.Popen`."""
    number: signal.Signals | None = None
    """A signal."""
    after: float = 0.0
    """Seconds until then."""
    codes: tuple[int, ...] | None = None
    """Exit codes allowed besides that of a run without a fault; None: all."""


class _Job(NamedTuple):
    """A command, and the file that it writes."""

    command: list[str]
    output: str | None = None
    code: int = 0
    """The exit code if nothing goes wrong."""


def run(rng: np.random.Generator, folder: Path) -> str:
    """Run a random fault."""
    name = str(rng.choice([*_FAULTS, "signal", "two at once", "interrupted call"]))
    if name == "interrupted call":
        return f"{name}: {_interrupted_call(rng)}"
    job = _job(rng, folder)
    if name == "two at once":
        fault, n_programs = Fault("", codes=()), 2
    else:
        fault, n_programs = _FAULTS[name](rng, folder), 1
    what = f"{name} {fault.what}, {job.command[2]}"
    try:
        programs = [
            _Program(folder, job.command, **(fault.options or {})) for _ in range(n_programs)
        ]
        if fault.number:
            programs[0].send(fault.number, fault.after)
        for program in programs:
            code, errors = program.finish()
            what += f", exit {code}"
            check_errors(errors)
            if fault.codes is not None and code not in (job.code, *fault.codes):
                raise Failure(errors[-200:])
            if code == 0 and job.output and (folder / job.output).read_bytes() == _BEFORE:
                raise Failure("nothing was written")
            _check_files(folder, job, program, code == -signal.SIGKILL)
    except Failure as failure:
        raise Failure(f"{failure}: {what}") from None
    return what


class _Program:
    """A command of adaptsize in a folder with temporary files of its own."""

    def __init__(self, folder: Path, command: list[str], **options: Any) -> None:
        self.mark = secrets.token_hex(8)
        self.scratch = folder / f"tmp-{self.mark}"
        self.scratch.mkdir()
        environment = {**os.environ, _MARK: self.mark, "TMPDIR": str(self.scratch)}
        environment |= options.get("env", {})
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
        options |= {"cwd": folder, "stdin": subprocess.DEVNULL, "env": environment}
        self.process = subprocess.Popen(
            [sys.executable, *command], start_new_session=True, **options
        )

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


def _job(rng: np.random.Generator, folder: Path) -> _Job:
    """Return a random command on a small surface; its output exists before or does not."""
    sphere = make("grid 3-D", rng).boundary
    field = np.full(sphere.n_points, 0.2)
    field[0] = 0.05
    ads.write(folder / "part.vtu", sphere, fields={"h0": field, "h": field})
    jobs = (
        _Job(["info", "part.vtu"]),
        _Job(["check", "part.vtu"], code=1),  # its edges are not as long as its sizes
        _Job(["limit", "part.vtu", "-g", "0.3", "--field", "h0", "-o", "out.vtu"], "out.vtu"),
        _Job(["size", "part.vtu", "-o", "out.vtu"], "out.vtu"),
        _Job(["remesh", "part.vtu", "--hmax", "0.3", "-o", "out.vtu"], "out.vtu"),
        _Job(["remesh", "part.vtu", "--hmax", "0.3", "-o", "out.mesh"], "out.mesh"),
    )
    job = jobs[int(rng.integers(0, len(jobs)))]
    if job.output and rng.random() < 0.5:
        (folder / job.output).write_bytes(_BEFORE)
    return job._replace(command=["-m", "adaptsize", *job.command])


def _check_files(folder: Path, job: _Job, program: _Program, is_killed: bool) -> None:
    """Raise a `Failure` if the output is neither whole nor as before, or other files are left."""
    hidden = [p.name for p in folder.iterdir() if p.name.startswith((".", "adaptsize-"))]
    left = hidden + sorted(path.name for path in program.scratch.iterdir())
    if left and not is_killed:
        raise Failure(f"unfinished or temporary files are left: {left}")
    output = folder / (job.output or "")
    if not output.is_file() or output.read_bytes() == _BEFORE:
        return
    try:
        ads.read(output)
    except ValueError as error:
        raise Failure(f"an output that is not whole, {error}") from error


def check_errors(errors: str) -> None:
    """Raise a `Failure` for a traceback or a long message."""
    if "Traceback" in errors and not _interrupts_the_start(errors):
        raise Failure(f"a traceback, {errors[-300:]!r}")
    if any(len(line) > _LONGEST for line in errors.splitlines()):
        raise Failure(f"a message of more than {_LONGEST} characters")


def _interrupts_the_start(errors: str) -> bool:
    """Whether Ctrl-C came before the command's own code, which is Python's to report."""
    files = set(re.findall(r'File "[^"]*/adaptsize/(.*?)"', errors))
    return errors.rstrip().endswith("KeyboardInterrupt") and files <= {"__init__.py", "_lazy.py"}


# --- faults ---------------------------------------------------------------------------------------


def _signal(rng: np.random.Generator, folder: Path) -> Fault:
    number = signal.Signals(
        rng.choice([signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
    )
    after = float(rng.choice([0.3, 1.0, 3.0, 8.0]) * rng.random())
    return Fault(f"{number.name} after {after:.2f} s", number=number, after=after)


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
        data = bytearray(path.read_bytes())
        cut = int(rng.integers(0, len(data) + 1))
        damage = str(rng.choice(["empty", "cut", "noise", "gone"]))
        if damage == "gone":
            path.unlink()
            continue
        if damage == "noise" and path.suffix == ".nbi":
            data[cut : cut + 20] = rng.bytes(20)
        else:
            data = data[: 0 if damage == "empty" else cut]
        path.write_bytes(data)
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
    active = getattr(background, "active", None)
    h0.flat[0 if active is None else int(np.flatnonzero(active)[0])] = 0.1
    expected = ads.limit_gradient(background, h0, 0.3)
    count = int(rng.integers(0, 4))

    def stop(text: str, share: float | None) -> None:
        nonlocal count
        count -= 1
        if count < 0:
            raise KeyboardInterrupt

    with contextlib.suppress(KeyboardInterrupt):
        ads.limit_gradient(background, h0, 0.3, progress=stop)
    if not np.array_equal(ads.limit_gradient(background, h0, 0.3), expected):
        raise Failure(f"another result after an interruption on {background!r}")
    return repr(background)
