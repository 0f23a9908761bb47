"""The child process: read job.npz and job.json, call the function, write result.npz.

Run as ``python -m adaptsize.remeshing._worker`` in the job's directory.
"""

import json
import os
import sys
from importlib import import_module

import numpy as np


def main() -> int:
    """Do the job in the working directory; return the exit code."""
    _die_with_parent()
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


def _die_with_parent() -> None:
    """Ask Linux to kill this process when its parent dies; elsewhere do nothing."""
    if sys.platform == "linux":
        import ctypes
        import signal

        set_death_signal = 1  # PR_SET_PDEATHSIG of <sys/prctl.h>
        ctypes.CDLL(None).prctl(set_death_signal, signal.SIGKILL)


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    # Exit without cleanup: some generators crash in their exit handlers.
    os._exit(code)
