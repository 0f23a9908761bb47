"""Calls of other packages in a child process with limited memory and time.

Readers of other packages print, warn, exit, run forever on a damaged file, expand a small one to
any size, or crash.  None of that reaches the caller: one child serves all calls of this process,
until it has been idle for some seconds or this process ends.  A child that exceeds its limits is
replaced.  Memory and processor time are limited where the system can do it (memory: Linux).

The child imports numpy and the package that it calls, and is ready after some tenths of a second.
"""

import atexit
import contextlib
import io
import os
import pickle
import re
import select
import signal
import subprocess
import sys
import tempfile
import threading
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

from adaptsize._children import how_it_ended, isolated, limits, pipe_of, start
from adaptsize._formats.guards import files_named_in
from adaptsize.errors import MeshFileError

#: What the largest file of a few bytes may take, and what each further byte may.
_MEMORY, _MEMORY_PER_BYTE = 700_000_000, 80
_SECONDS, _SECONDS_PER_BYTE = 5.0, 5e-6
#: Waiting time over processor time, for a machine that does other things as well.
_PATIENCE = 10.0
_IDLE_SECONDS = 15.0
_SERVE = f"""
os.environ |= {{"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}}
from {__name__} import _serve
_serve()
"""

_LOCK = threading.Lock()
_CHILD: subprocess.Popen[bytes] | None = None


def read_limited(function: str, path: Path, *arguments: Any) -> Any:
    """Call ``function(path, *arguments)``, with limits that follow from the size of the file.

    Parameters
    ----------
    function : str
        Its module in ``adaptsize._formats`` and its name, as ``"foreign.read_vtk"``.

    Returns
    -------
    Any
        What the function returns.

    Raises
    ------
    MeshFileError
        If the function raises, crashes or exceeds a limit.
    """
    global _CHILD  # noqa: PLW0603 - one for all calls
    size = sum(file.stat().st_size for file in [path, *files_named_in(path)])
    seconds, memory = _SECONDS + _SECONDS_PER_BYTE * size, _MEMORY + _MEMORY_PER_BYTE * size
    job = function, str(path.absolute()), arguments
    with _LOCK:
        while True:
            if _CHILD is not None and _CHILD.poll() is not None:
                _drop()  # writing to it could end this process, too, by SIGPIPE
            if _CHILD is None:
                streams = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
                _CHILD = start(isolated(_SERVE), tempfile.gettempdir(), **streams)
            child = _CHILD
            to_child, from_child = pipe_of(child.stdin), pipe_of(child.stdout)
            timer = threading.Timer(_PATIENCE * seconds, child.kill)
            try:
                timer.start()
                pickle.dump((job, seconds, memory), to_child)
                to_child.flush()
                result, error = pickle.load(from_child)
                break
            except (BrokenPipeError, EOFError, pickle.UnpicklingError):  # it has ended
                if code := _drop():  # otherwise it was idle for too long
                    raise MeshFileError(_reason(code, seconds)) from None
            except BaseException:  # an interrupt
                child.kill()
                _drop()
                raise
            finally:
                timer.cancel()
    if error is not None:
        raise MeshFileError(error)
    return result


def _drop() -> int:
    """End the child if there is one, and return its exit code."""
    global _CHILD
    child, _CHILD = _CHILD, None
    if child is None:
        return 0
    for pipe in (child.stdin, child.stdout):
        with contextlib.suppress(OSError):
            if pipe is not None:
                pipe.close()
    return child.wait()


def _forget() -> None:
    """Leave the child to the parent of a forked process."""
    global _CHILD, _LOCK
    if _CHILD is not None:
        _CHILD.returncode = 0
    _CHILD, _LOCK = None, threading.Lock()


def _end() -> None:
    """End the child at the end of this process, without waiting for what it does."""
    if _CHILD is not None:
        _CHILD.kill()
    _drop()


atexit.register(_end)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def _reason(code: int, seconds: float) -> str:
    ended = how_it_ended(code)
    if ended in ("SIGXCPU", "SIGTERM", "SIGKILL"):
        return (
            f"takes more than {seconds:.2g} s of processor time or too much memory, which its "
            "size does not justify; it is damaged or malicious"
        )
    return f"makes its reader crash ({ended}); it is damaged or too large for this machine"


# --- the child ------------------------------------------------------------------------------------


def _serve() -> None:
    """Do the jobs that are written to standard input, and write their results."""
    replies = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    with contextlib.suppress(EOFError):
        while sys.platform == "win32" or select.select([0], [], [], _IDLE_SECONDS)[0]:
            job, seconds, memory = pickle.load(sys.stdin.buffer)
            with limits(seconds, memory):
                try:
                    pickle.dump(_done(*job), replies)
                    replies.flush()
                except MemoryError:  # a part may have been written
                    os.kill(os.getpid(), signal.SIGTERM)


def _done(name: str, path: str, arguments: tuple[Any, ...]) -> tuple[Any, str | None]:
    """Return the result of a call, or the text of its error."""
    printed = io.StringIO()
    with (
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(printed),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        try:
            module, _, function = name.partition(".")
            read = getattr(import_module(f"adaptsize._formats.{module}"), function)
            return read(Path(path), *arguments), None
        except MeshFileError as error:
            return None, str(error)
        except MemoryError:
            return None, "needs more memory than its size justifies"
        # Packages derive some errors from Exception only, and meshio calls sys.exit.
        except (Exception, SystemExit) as error:
            return None, f"cannot be read ({_line(error, printed.getvalue())})"


def _line(error: BaseException, printed: str) -> str:
    """Return one short line with the error of another package."""
    if missing := re.search(r"No module named '(\w+)", str(error)):
        return f"needs the package {missing[1]} (pip install {missing[1]})"
    lines = printed if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}"
    text = "; ".join(line.strip().rstrip(".") for line in lines.splitlines() if line.strip())
    line = " ".join(text.split()) or type(error).__name__
    return line if len(line) <= 160 else line[:157] + "..."
