"""The entry point: errors become one line and an exit code."""

from __future__ import annotations

import _thread
import atexit
import contextlib
import os
import shlex
import signal
import sys
import threading
import time
import traceback
import types
import warnings
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    import typer

DONE, REFUSED, USAGE, INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    The codes are 0 done, 1 failed, 2 wrong usage (the command line must be changed: an error of
    `typer`, or an `OptionError` about an option of the command), 130 interrupted, 143 terminated.

    Parameters
    ----------
    arguments : sequence of str, optional
        By default those of the process.
    """
    _open_closed_streams()
    try:
        with _no_interrupt_is_lost():
            code = run(sys.argv[1:] if arguments is None else list(arguments))
    except KeyboardInterrupt:  # during the imports
        code = _stopped([])
    if arguments is None:  # the process ends here
        _ignore_signals()
    else:  # of another program, which may go on
        atexit.register(_ignore_signals)
    sys.exit(code)


def _ignore_signals() -> None:
    """Let no signal interrupt what is done at exit: Python would print it and exit with 0."""
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), signal.SIG_IGN)


def _open_closed_streams() -> None:
    """Send the output to nowhere if it is closed (``>&-``), before a file gets its number."""
    for stream in ("stdin", "stdout", "stderr"):
        if getattr(sys, stream) is None:
            mode = "r" if stream == "stdin" else "w"
            setattr(sys, stream, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115


@contextlib.contextmanager
def _no_interrupt_is_lost() -> Iterator[None]:
    """Repeat an interrupt that comes where Python ignores exceptions.

    These are the callbacks of weak references, which every import has, and ``__del__``.  Python
    would print a traceback and continue.
    """
    before = sys.unraisablehook

    def repeat(unraisable: sys.UnraisableHookArgs) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            thread = threading.Thread(target=_interrupt_after, args=(repeat.__code__,))
            thread.start()
        else:
            before(unraisable)

    sys.unraisablehook = repeat
    try:
        yield
    finally:
        sys.unraisablehook = before


def _interrupt_after(code: types.CodeType) -> None:
    """Interrupt the main thread when it has left a function, in which that would be ignored.

    It also interrupts what waits, where the system can do that.
    """
    main = cast("int", threading.main_thread().ident)
    while _is_in(code, sys._current_frames().get(main)):
        time.sleep(0.001)
    if sys.platform == "win32":
        _thread.interrupt_main()
    else:
        signal.pthread_kill(main, signal.SIGINT)


def _is_in(code: types.CodeType, frame: types.FrameType | None) -> bool:
    """Return whether a function is among the callers of a frame, or is its own."""
    while frame is not None and frame.f_code is not code:
        frame = frame.f_back
    return frame is not None


def run(arguments: list[str]) -> int:
    """Run the command line and return the exit code."""
    import typer
    from typer.main import get_command

    from adaptsize import errors
    from adaptsize._messages import message_of
    from adaptsize.cli.commands import app
    from adaptsize.cli.console import Console

    console = Console()
    console.typed = shlex.join(["adaptsize", *arguments])
    # typer vendors click or imports it.  This finds the class in both cases.
    usage_error = cast("type[typer.BadParameter]", typer.BadParameter.__bases__[0])
    received: list[signal.Signals] = []
    debug = "--debug" in arguments  # at any position
    arguments = [word for word in arguments if word != "--debug"]
    try:
        with _signals_as_interrupt(received), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings of other packages
            for kind in vars(errors).values():
                if isinstance(kind, type) and issubclass(kind, Warning):
                    warnings.simplefilter("always", kind)
            # Restored by catch_warnings.
            warnings.showwarning = lambda message, *_, **__: console.warn(message_of(message))
            result = get_command(app).main(
                arguments, prog_name="adaptsize", standalone_mode=False, obj=console
            )
            sys.stdout.flush()
        if result == INTERRUPTED:  # typer's exit code for Ctrl-C
            return _stopped(received)
        return result if isinstance(result, int) else DONE
    except usage_error as error:
        if not arguments:
            error.show(file=sys.stderr)  # the help
        else:
            console.fail(ValueError(_text_of_usage(error, arguments)))
        return USAGE
    except (KeyboardInterrupt, typer.Abort):
        return _stopped(received)
    except (BrokenPipeError, SystemExit) as error:  # typer converts the first to the second
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):
            raise
        # The reader of our output has closed the pipe.  This is not an error.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except (ValueError, RuntimeError, ImportError, OSError, MemoryError) as error:
        if debug:
            traceback.print_exc()
        return USAGE if console.fail(error) else REFUSED


def _text_of_usage(error: typer.BadParameter, arguments: list[str]) -> str:
    """Return in one line what is wrong with the words of a command, and where its options are."""
    text = error.format_message().rstrip(".")
    context, flags = getattr(error, "ctx", None), getattr(getattr(error, "param", None), "opts", [])
    # typer's versions have different words for these, not all with the value.
    kinds = {"integer": "a whole number", "float": "a number", "number": "a number"}
    wanted = next((kind for word, kind in kinds.items() if f" valid {word}" in text), "")
    pairs = zip(arguments, [*arguments[1:], ""], strict=False)
    typed = [value for word, after in pairs for value in _value_of(flags, word, after)]
    if wanted and typed:
        text = f"{flags[-1]} must be {wanted}, got {typed[-1]!r}"
    path = "adaptsize" if context is None else context.command_path
    if context is None and not arguments[0].startswith("-"):
        path = f"adaptsize {arguments[0]}"  # typer does not say of which command the words are
    return f"{text}; {path} -h prints the help"


def _value_of(flags: Sequence[str], word: str, following: str) -> list[str]:
    """Return the value that a word gives to an option, at most one."""
    if word in flags:
        return [following]
    name, equals, value = word.partition("=")
    return [value] if equals and name in flags else []


@contextlib.contextmanager
def _signals_as_interrupt(received: list[signal.Signals]) -> Iterator[None]:
    """Raise KeyboardInterrupt on signals, so that nothing is left half-written.

    Where there are timers, a signal that arrives during an import waits until that has ended:
    VTK's modules crash where an exception is raised while they load.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []

    def interrupt(number: int, frame: types.FrameType | None) -> None:
        if "SIGALRM" in handlers and _is_importing(frame):
            # A thread would not do: a handler that starts one can be interrupted, and never end.
            waiting.append(number)
            signal.setitimer(signal.ITIMER_REAL, 0.01)
        elif number == signal.SIGINT:
            raise KeyboardInterrupt
        # No second interrupt while files are removed.  Python reports signals that are set to be
        # ignored after they have arrived.
        elif not received:
            received.append(signal.Signals(number))
            raise KeyboardInterrupt

    def send_again(_number: int, _frame: object) -> None:
        if waiting:
            signal.raise_signal(waiting.pop())

    # A signal that is ignored, as SIGHUP under nohup, or of which another program makes use stays
    # as it is.
    handlers = {
        name: send_again if name == "SIGALRM" else interrupt
        for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGALRM")
        if hasattr(signal, name)
        and signal.getsignal(signal.Signals[name]) in (signal.SIG_DFL, signal.default_int_handler)
    }
    before = {name: signal.signal(signal.Signals[name], own) for name, own in handlers.items()}
    try:
        yield
    finally:
        if "SIGALRM" in handlers:
            signal.setitimer(signal.ITIMER_REAL, 0)
        for name, old in before.items():
            signal.signal(signal.Signals[name], old)


def _is_importing(frame: types.FrameType | None) -> bool:
    """Whether what the command runs in this frame is the import of a module."""
    while frame is not None and frame.f_code is not run.__code__:
        if frame.f_code.co_filename.startswith("<frozen importlib."):
            return True
        frame = frame.f_back
    return False


def _stopped(received: list[signal.Signals]) -> int:
    """Say that the command was stopped, and return the exit code."""
    reason, code = "interrupted", INTERRUPTED
    if received:
        reason, code = f"stopped by {received[0].name}", 128 + received[0]
    print(f"adaptsize: {reason}", file=sys.stderr)
    return code
