"""The classes of cases, and the class of each number."""

import contextlib
import os
import signal
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np

#: Of a hundred consecutive numbers, how many belong to each class.
SHARES = {"calls": 60, "forms": 15, "files": 25}

#: The first number of the sweep over all arguments, see `calls.sweep`.
SWEEP = 1 << 40

#: The first numbers of the classes of long cases, which run on request.
LONG = {"sequences": 1 << 41, "signals": 1 << 42}

#: Seconds of processor time and of wall time after which a case counts as hanging.
_LIMITS = {
    "files": (30.0, 120.0),
    "sequences": (120.0, 300.0),
    "signals": (60.0, 120.0),
    "selftest": (1.0, 60.0),
}

_CLASSES = [name for name, share in SHARES.items() for _ in range(share)]

#: Characters of the longest message that is clear.
LONGEST = 1000


class Failure(Exception):
    """What adaptsize must not do; the text says what it was."""


@contextlib.contextmanager
def told_with(what: str) -> Iterator[None]:
    """Add what was tried to a failure in the block."""
    try:
        yield
    except Failure as failure:
        raise Failure(f"{failure}: {what}") from failure.__cause__


def class_of(number: int) -> str:
    """Return the class of a case."""
    if number < 0:
        return "selftest"
    for name, first in reversed(LONG.items()):
        if number >= first:
            return name
    # A step without a common factor mixes the classes.
    return "sweep" if number >= SWEEP else _CLASSES[number * 37 % len(_CLASSES)]


def limits_of(number: int) -> tuple[float, float]:
    """Return after how many seconds of processor time and of wall time a case hangs."""
    return _LIMITS.get(class_of(number), (60.0, 300.0))


def run(number: int, folder: Path) -> str:
    """Run a case in an empty folder and describe it; raise a `Failure` if it fails."""
    name = class_of(number)
    if name == "selftest":
        return _end_badly(number)
    rng = np.random.default_rng([20260214, number])
    if name == "sweep":
        return str(import_module(f"{__package__}.calls").sweep(number - SWEEP, rng))
    return str(import_module(f"{__package__}.{name}").run(rng, folder))


def _end_badly(number: int) -> str:
    """Do what the attack must notice."""
    if number == -1:
        os.kill(os.getpid(), signal.SIGSEGV)
    while number == -2:
        pass
    if number == -4:
        bytearray(64 << 30)
    raise Failure("on purpose")
