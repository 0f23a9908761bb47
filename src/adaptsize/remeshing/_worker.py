"""The child process of a generator: run a function of arrays, limit the processor time."""

import json
import math
import os
import time
from importlib import import_module
from importlib.util import find_spec

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


def limit_processor_time(seconds: float) -> None:
    """Have the system end this process after so many more seconds of processor time.

    Windows has no such limit.
    """
    if find_spec("resource") is None:
        return
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    used = time.process_time()
    limit = math.ceil(used + seconds)
    if hard != resource.RLIM_INFINITY:
        limit = min(limit, hard)
    resource.setrlimit(resource.RLIMIT_CPU, (limit, hard))
