"""The entry point: errors become one line and an exit code."""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from typing import Any

DONE, REFUSED, USAGE, INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: 0 done, 1 refused or failed, 2 usage, 130 interrupted.

    Parameters
    ----------
    arguments : sequence of str, optional
        By default those of the process.
    """
    _open_closed_streams()
    try:
        code = run(sys.argv[1:] if arguments is None else list(arguments))
    except KeyboardInterrupt:  # during the imports
        print("adaptsize: interrupted", file=sys.stderr)
        code = INTERRUPTED
    sys.exit(code)


def _open_closed_streams() -> None:
    """Send the output to nowhere if it is closed (``>&-``), before a file gets its number."""
    for stream in ("stdin", "stdout", "stderr"):
        if getattr(sys, stream) is None:
            mode = "r" if stream == "stdin" else "w"
            setattr(sys, stream, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115


def run(arguments: list[str]) -> int:
    """Run the command line and return the exit code."""
    import typer
    from typer.main import get_command

    from adaptsize.cli.commands import app
    from adaptsize.errors import (
        ConvergenceWarning,
        ImageWarning,
        MeshRepairWarning,
        OutsideWarning,
        ResolutionWarning,
    )

    # typer vendors click or imports it.  This finds the class in both cases.
    usage_error: Any = typer.BadParameter.__bases__[0]
    ours = (ConvergenceWarning, ImageWarning, MeshRepairWarning, OutsideWarning, ResolutionWarning)
    debug = "--debug" in arguments  # at any position
    arguments = [word for word in arguments if word != "--debug"]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings of other packages
            for category in ours:
                warnings.simplefilter("always", category)
            warnings.showwarning = _show_warning  # restored by catch_warnings
            result = get_command(app).main(arguments, prog_name="adaptsize", standalone_mode=False)
            sys.stdout.flush()
        if result == INTERRUPTED:  # typer's exit code for Ctrl-C
            _say("interrupted")
        return result if isinstance(result, int) else DONE
    except usage_error as error:
        error.show(file=sys.stderr)
        return USAGE
    except (KeyboardInterrupt, typer.Abort):
        _say("interrupted")
        return INTERRUPTED
    except (BrokenPipeError, SystemExit) as error:  # typer converts the first to the second
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):
            raise
        # The reader of our output has closed the pipe.  This is not an error.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except (ValueError, RuntimeError, ImportError, OSError, MemoryError) as error:
        if debug:
            traceback.print_exc()
        _say(f"error: {_in_one_line(error)}")
        return REFUSED


def _in_one_line(error: BaseException | str) -> str:
    text = " ".join(str(error).split())
    return text or type(error).__name__


def _say(text: str) -> None:
    print(f"adaptsize: {text}", file=sys.stderr)


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    _say(f"warning: {_in_one_line(message)}")
