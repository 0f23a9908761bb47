"""The child process of a generator: run a function of arrays."""

import json
import os
from importlib import import_module

import numpy as np


def main() -> int:
    """Do the job in the working directory; return the exit code."""
    with open("job.json", encoding="utf-8") as file:
        job = json.load(file)
    with np.load("job.npz", allow_pickle=False) as loaded:
        arrays = {name: loaded[name] for name in loaded.files}
    module, name = job["function"].split(":")
    try:
        result = getattr(import_module(module), name)(arrays, job["options"])
    except Exception as error:  # a generator may raise anything
        with open("error.txt", "w", encoding="utf-8") as file:
            file.write(f"{type(error).__name__}: {error}")
        return 1
    np.savez("unfinished.npz", **result)
    os.replace("unfinished.npz", "result.npz")
    return 0
