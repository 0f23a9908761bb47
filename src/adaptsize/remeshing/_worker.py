"""The child process of a generator: run a function of arrays."""

import os
import pickle
from importlib import import_module
from pathlib import Path

import numpy as np


def main() -> int:
    """Do the job in the working directory; return the exit code."""
    function, arrays, options = pickle.loads(Path("job").read_bytes())
    module, name = function.split(":")
    try:
        result = getattr(import_module(module), name)(arrays, options)
    except Exception as error:  # a generator may raise anything
        Path("error.txt").write_text(f"{type(error).__name__}: {error}", encoding="utf-8")
        return 1
    whole = {name: np.asarray(values) for name, values in result.items()}
    Path("unfinished").write_bytes(pickle.dumps(whole))
    os.replace("unfinished", "result")
    return 0
