"""Commands that are stopped by signals at random moments: how they end, and what they leave."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from meshes import jittered_square
from shapes import block

import adaptsize as ads

from .cases import Failure

#: Seconds in which a command must end after a signal.
_PATIENCE = 30.0
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
_COMMANDS = {
    "info": "info in.vtu",
    "limit": "limit in.vtu -o out.vtu --field h0 -g 0.2",
    "size": "size in.vtu -o out.vtu --hmax 0.3",
    "remesh": "remesh in.vtu -o out.vtu --hmax 0.2",
    "remesh a solid": "remesh solid.vtu -o out.vtu --hmax 0.3",
    "remesh a surface": "remesh surface.stl -o out.vtu --hmax 0.3",
    "adapt": "adapt in.vtu -o out.msh --field eta --elements 500",
    "check": "check in.vtu",
}


def run(rng: np.random.Generator, folder: Path) -> str:
    """Stop a random command at a random moment, once or twice."""
    _write_inputs(folder)
    name = str(rng.choice([*_COMMANDS]))
    numbers = [signal.Signals[str(rng.choice(_SIGNALS))] for _ in range(int(rng.integers(1, 3)))]
    moments = [float(rng.uniform(0.0, 4.0)), float(rng.choice([0.0, 0.001, 0.02, 0.2]))]
    text = f"{name}: {' and '.join(n.name for n in numbers)} after {moments[0]:.3f} s"
    if len(numbers) > 1:
        text += f" and {moments[1]} s"
    before = {*folder.iterdir()}
    temporary = folder / "temporary"
    temporary.mkdir()
    child = subprocess.Popen(
        [sys.executable, "-m", "adaptsize", *_COMMANDS[name].split()],
        cwd=folder,
        env={**os.environ, "TMPDIR": str(temporary)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        for moment, number in zip(moments, numbers, strict=False):
            time.sleep(moment)
            with contextlib.suppress(ProcessLookupError):
                child.send_signal(number)
        try:
            out, err = child.communicate(timeout=_PATIENCE)
        except subprocess.TimeoutExpired:
            raise Failure(f"{text}: goes on for {_PATIENCE:g} s") from None
        _check(child.returncode, numbers, out, err, text)
        _check_rest(child.pid, text)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
    left = [path.name for path in temporary.iterdir()]
    if left:
        raise Failure(f"{text}: leaves {left} among temporary files")
    new = {path.name for path in {*folder.iterdir()} - before - {temporary}}
    if new - {"out.vtu", "out.vtu.json", "out.msh"}:
        raise Failure(f"{text}: leaves {sorted(new)}")
    for file in ("out.vtu", "out.msh"):
        if file in new:
            ads.read(folder / file)  # whole, or not there
    shutil.rmtree(temporary)
    return f"{text}: exits with {child.returncode}"


def _write_inputs(folder: Path) -> None:
    mesh = jittered_square(8, 1, half_width=1.0)
    h0 = np.where(np.arange(mesh.n_points) % 9 == 0, 0.05, 0.5)
    mesh = mesh.with_data(point_data={"h0": h0}, cell_data={"eta": mesh.measures})
    ads.write(folder / "in.vtu", mesh)
    ads.write(folder / "solid.vtu", block(2))
    ads.write(folder / "surface.stl", block(2).boundary().mesh)


def _check(code: int, numbers: list[signal.Signals], out: str, err: str, text: str) -> None:
    """Refuse another exit code than that of one of the signals, or of the end, and tracebacks."""
    whole = f"{text}: exits with {code}, prints {err[-1500:]!r}"
    if err.startswith("Fatal Python error: init"):
        return  # Python itself had not begun
    if code == 130 and not err and signal.SIGINT in numbers:
        return  # while it imported
    if "Traceback" in err + out or "Exception ignored" in err or "Error in" in err:
        raise Failure(whole)
    if code in (0, 1) and "adaptsize: error" not in err and "stopped" not in err:
        return  # it had ended; 1 is that of a mesh that does not pass
    if code in [-number for number in numbers] and not out:
        return  # before it began
    last = err.strip().splitlines()[-1:] or [""]
    for number in numbers:
        is_interrupt = number == signal.SIGINT
        wanted = "interrupted" if is_interrupt else f"stopped by {number.name}"
        if code == 128 + number and last[0] == f"adaptsize: {wanted}":
            return
    raise Failure(whole)


def _check_rest(group: int, text: str) -> None:
    """Refuse children that go on."""
    for _ in range(50):
        try:
            os.killpg(group, 0)
        except (ProcessLookupError, PermissionError):
            return
        time.sleep(0.1)
    raise Failure(f"{text}: its children go on")
