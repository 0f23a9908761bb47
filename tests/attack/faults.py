"""Faults around adaptsize: signals, a full disk, closed pipes, a damaged cache, bad generators.

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


def run(rng: np.random.Generator, folder: Path) -> str:
    """Run a random fault."""
    name = str(rng.choice(list(_FAULTS)))
    try:
        return f"{name}: {_FAULTS[name](rng, folder)}"
    except Failure as failure:
        raise Failure(f"{failure}: {name}") from None


class Program:
    """A command of adaptsize in a folder with temporary files of its own."""

    def __init__(self, folder: Path, command: list[str], **options: Any) -> None:
        self.mark = secrets.token_hex(8)
        self.scratch = folder / f"tmp-{self.mark}"
        self.scratch.mkdir()
        environment = {**os.environ, _MARK: self.mark, "TMPDIR": str(self.scratch)}
        environment |= options.pop("environment", {})
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
        self.process = subprocess.Popen(
            [sys.executable, *command],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            env=environment,
            start_new_session=True,
            **options,
        )

    def finish(self, seconds: float = _PATIENCE) -> tuple[int, str]:
        """Wait for the end; return the exit code and what was printed to standard error."""
        try:
            errors = self.process.communicate(timeout=seconds)[1]
        except subprocess.TimeoutExpired:
            raise Failure(f"no end after {seconds:g} s") from None
        finally:
            left = self._end_others(3.0)
        if left:
            raise Failure(f"left behind: {'; '.join(left)}")
        return self.process.returncode, (errors or b"").decode("utf-8", "replace")

    def leftovers(self) -> list[str]:
        """Return the temporary files that are still there."""
        return sorted(path.name for path in self.scratch.iterdir())

    def _end_others(self, patience: float) -> list[str]:
        """End the processes that still run after a while, and return their command lines."""
        until = time.monotonic() + patience
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


class _Job(NamedTuple):
    """A command, and the file that it writes."""

    command: list[str]
    output: str | None
    code: int = 0
    """The exit code if nothing goes wrong."""


def _job(rng: np.random.Generator, folder: Path) -> _Job:
    """Return a random command on a small surface; its output exists before or does not."""
    sphere = make("grid 3-D", rng).boundary
    field = np.full(sphere.n_points, 0.2)
    field[0] = 0.05
    ads.write(folder / "part.vtu", sphere, fields={"h0": field, "h": field})
    jobs = (
        _Job(["info", "part.vtu"], None),
        _Job(["check", "part.vtu"], None, 1),  # its edges are not as long as its sizes
        _Job(["limit", "part.vtu", "-g", "0.3", "--field", "h0", "-o", "out.vtu"], "out.vtu"),
        _Job(["size", "part.vtu", "-o", "out.vtu"], "out.vtu"),
        _Job(["remesh", "part.vtu", "--hmax", "0.3", "-o", "out.vtu"], "out.vtu"),
        _Job(["remesh", "part.vtu", "--hmax", "0.3", "-o", "out.mesh"], "out.mesh"),
    )
    job = jobs[int(rng.integers(0, len(jobs)))]
    if job.output and rng.random() < 0.5:
        (folder / job.output).write_bytes(_BEFORE)
    return job._replace(command=["-m", "adaptsize", *job.command])


def _check_output(folder: Path, job: _Job, code: int) -> None:
    """Raise a `Failure` if the output is neither whole nor as it was before."""
    hidden = [p.name for p in folder.iterdir() if p.name.startswith((".", "adaptsize-"))]
    if hidden and code != -signal.SIGKILL:
        raise Failure(f"unfinished files are left: {hidden}")
    if job.output is None or not (folder / job.output).exists():
        return
    if (folder / job.output).read_bytes() == _BEFORE:
        return
    try:
        ads.read(folder / job.output)
    except ValueError as error:
        raise Failure(f"an output that is not whole, {error}") from error


def _interrupts_the_start(errors: str) -> bool:
    """Whether Ctrl-C came before the command's own code, which is Python's to report."""
    files = re.findall(r'File "[^"]*/adaptsize/(.*?)"', errors)
    return errors.rstrip().endswith("KeyboardInterrupt") and set(files) <= {
        "__init__.py",
        "_lazy.py",
    }


def _check_errors(errors: str) -> None:
    if "Traceback" in errors and not _interrupts_the_start(errors):
        raise Failure(f"a traceback, {errors[-300:]!r}")
    if any(len(line) > _LONGEST for line in errors.splitlines()):
        raise Failure(f"a message of more than {_LONGEST} characters")


# --- faults ---------------------------------------------------------------------------------------


def _signalled(rng: np.random.Generator, folder: Path) -> str:
    job = _job(rng, folder)
    number = int(rng.choice([signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL]))
    after = float(rng.choice([0.3, 1.0, 3.0, 8.0]) * rng.random())
    program = Program(folder, job.command)
    with contextlib.suppress(subprocess.TimeoutExpired):
        program.process.wait(after)
    program.process.send_signal(number)
    code, errors = program.finish()
    what = f"{signal.Signals(number).name} after {after:.2f} s, {job.command[2]}, exit {code}"
    try:
        _check_errors(errors)
        _check_output(folder, job, code)
        if number != signal.SIGKILL and program.leftovers():
            raise Failure(f"temporary files are left: {program.leftovers()}")
    except Failure as failure:
        raise Failure(f"{failure}, {what}") from None
    return what


def _disk_full(rng: np.random.Generator, folder: Path) -> str:
    job = _job(rng, folder)
    room = int(rng.choice([0, 10, 500, 3000, 20_000, 100_000]) * rng.random())

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    program = Program(folder, job.command, preexec_fn=limit)
    code, errors = program.finish()
    what = f"{room} bytes, {job.command[2]}, exit {code}"
    try:
        _check_errors(errors)
        _check_output(folder, job, code)
        if code not in (0, 1):
            raise Failure(f"exit {code}, {errors[-200:]!r}")
    except Failure as failure:
        raise Failure(f"{failure}, {what}") from None
    return what


def _closed_pipes(rng: np.random.Generator, folder: Path) -> str:
    job = _job(rng, folder)
    which = str(rng.choice(["stdout", "stderr", "both", "reader gone"]))

    def close() -> None:
        for number in {"stdout": [1], "stderr": [2], "both": [1, 2]}.get(which, []):
            os.close(number)

    options: dict[str, Any] = {"preexec_fn": close}
    if which == "reader gone":
        reader, writer = os.pipe()
        os.close(reader)
        options["stdout"] = writer
    program = Program(folder, job.command, **options)
    if which == "reader gone":
        os.close(writer)
    code, errors = program.finish()
    what = f"{which}, {job.command[2]}, exit {code}"
    try:
        _check_errors(errors)
        _check_output(folder, job, code)
    except Failure as failure:
        raise Failure(f"{failure}, {what}") from None
    return what


def _damaged_cache(rng: np.random.Generator, folder: Path) -> str:
    job = _job(rng, folder)
    if rng.random() < 0.5:
        job = _Job(["-m", "adaptsize", "info", "part.vtu"], None)
    kernels = Path(os.environ.get("NUMBA_CACHE_DIR", ""))
    cache = folder / "cache"
    if kernels.is_dir() and kernels.name:
        shutil.copytree(kernels, cache, ignore=lambda d, names: [n for n in names if n == "bounds"])
    cache.mkdir(exist_ok=True)
    files = sorted(path for path in cache.rglob("*.nb?") if path.is_file())
    for path in files:
        if rng.random() < 0.3:
            data = bytearray(path.read_bytes())
            cut = int(rng.integers(0, len(data) + 1))
            damage = str(rng.choice(["empty", "cut", "noise", "gone"]))
            if damage == "noise" and path.suffix == ".nbi":
                data[cut : cut + 20] = rng.bytes(20)
            elif damage == "gone":
                path.unlink()
                continue
            else:
                data = data[: 0 if damage == "empty" else cut]
            path.write_bytes(data)
    program = Program(folder, job.command, environment={"NUMBA_CACHE_DIR": str(cache)})
    code, errors = program.finish()
    what = f"{len(files)} files, {job.command[2]}, exit {code}"
    try:
        _check_errors(errors)
        _check_output(folder, job, code)
        if code != job.code:
            raise Failure(f"exit {code}, {errors[-200:]!r}")
    except Failure as failure:
        raise Failure(f"{failure}, {what}") from None
    return what


def _two_at_once(rng: np.random.Generator, folder: Path) -> str:
    job = _job(rng, folder)
    programs = [Program(folder, job.command) for _ in range(2)]
    for program in programs:
        code, errors = program.finish()
        _check_errors(errors)
        if code != job.code:
            raise Failure(f"exit {code}, {errors[-200:]!r}, {job.command[2]}")
    _check_output(folder, job, 0)
    if job.output and (folder / job.output).read_bytes() == _BEFORE:
        raise Failure("nothing was written")
    return job.command[2]


_GENERATORS = {
    "crash": False, "abort": False, "killed": False, "fail": False, "leave_early": False,
    "empty": False, "not_finite": False, "hang": False, "chatter": False, "litter": True,
    "hang_with_stray": False, "leave_children": True, "copy": True, "far_away": False,
    "one_of_them": False, "half": False, "shrunk": False, "moved": False, "doubled": False,
    "slow_and_large": False, "wrong_names": False, "wrong_shapes": False,
}  # fmt: skip
"""Functions of `fake_generators` and `lies`, and whether their result is a mesh of the part."""


def _bad_generator(rng: np.random.Generator, folder: Path) -> str:
    name = str(rng.choice(list(_GENERATORS)))
    code = (
        "import sys, numpy as np, adaptsize as ads\n"
        "from pathlib import Path\n"
        "from tests.attack import lies\n"
        f"print(lies.remesh_with({name!r}))\n"
    )
    root = Path(__file__).parents[2]
    paths = [str(root), str(root / "tests" / "support"), *filter(None, sys.path)]
    environment = {"PYTHONPATH": os.pathsep.join(paths)}
    program = Program(folder, ["-c", code], environment=environment)
    program.process.wait(_PATIENCE)
    printed = (program.process.stdout or open(os.devnull, "rb")).read().decode()  # noqa: SIM115
    exit_code, errors = program.finish()
    if exit_code != 0:
        raise Failure(f"{name}, exit {exit_code}, {errors[-300:]!r}")
    if printed.startswith("made") and not _GENERATORS[name]:
        raise Failure(f"{name}, a wrong mesh was returned: {printed.strip()}")
    if not printed.startswith("made") and _GENERATORS[name]:
        raise Failure(f"{name}, a right mesh was refused: {printed.strip()[:200]}")
    if program.leftovers():
        raise Failure(f"{name}, temporary files are left: {program.leftovers()}")
    return f"{name}, {printed.strip()[:200]}"


def _interrupted_library(rng: np.random.Generator, folder: Path) -> str:
    """Interrupt a call in the middle, then repeat it: the result must be that of a new process."""
    background = any_background(rng)
    h0 = np.full(background.nodal_shape, np.inf)
    h0.flat[0] = 0.1
    if getattr(background, "active", None) is not None:
        h0.flat[int(np.flatnonzero(background.active)[0])] = 0.1
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


_FAULTS: dict[str, Callable[[np.random.Generator, Path], str]] = {
    "signal": _signalled,
    "signal again": _signalled,
    "disk full": _disk_full,
    "closed pipes": _closed_pipes,
    "damaged cache": _damaged_cache,
    "two at once": _two_at_once,
    "bad generator": _bad_generator,
    "interrupted call": _interrupted_library,
}
