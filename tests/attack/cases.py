"""The classes of cases, and the class of each number."""

from importlib import import_module
from pathlib import Path

import numpy as np

#: Of a hundred consecutive numbers, how many belong to each class.
SHARES = {"calls": 50, "forms": 10, "limiting": 18, "files": 20, "faults": 2}

#: Seconds of processor time and of wall time after which a case counts as hanging.
LIMITS = {
    "calls": (60.0, 300.0),
    "forms": (60.0, 300.0),
    "limiting": (60.0, 300.0),
    "files": (30.0, 120.0),
    "faults": (300.0, 2000.0),
    "selftest": (3.0, 60.0),
}

_CLASSES = [name for name, share in SHARES.items() for _ in range(share)]


class Failure(Exception):
    """What adaptsize must not do; the text says what it was."""


def class_of(number: int) -> str:
    """Return the class of a case."""
    if number < 0:
        return "selftest"
    # A step without a common factor mixes the classes.
    return _CLASSES[number * 37 % len(_CLASSES)]


def run(number: int, folder: Path) -> str:
    """Run a case in an empty folder and describe it; raise a `Failure` if it fails."""
    name = class_of(number)
    module = import_module(f"{__package__}.{name}")
    if name == "selftest":
        return str(module.run(number))
    return str(module.run(np.random.default_rng([20260214, number]), folder))
