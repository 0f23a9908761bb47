"""A child process that runs cases: one number per line in, one line of JSON per case out."""

import contextlib
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

import numba

from .cases import Failure, class_of, limits_of, run

#: Bytes of private memory that a case may use.
_MEMORY = 4 << 30

#: Of processor time, whose signal is SIGPROF, and of wall time, whose signal is SIGALRM.
_TIMERS = (signal.ITIMER_PROF, signal.ITIMER_REAL)


def main() -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (_MEMORY, _MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # Whatever a case prints goes elsewhere than the answers.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        number = int(line)
        # The kernel ends a child that hangs, also inside of compiled code.
        for timer, limit in zip(_TIMERS, limits_of(number), strict=True):
            signal.setitimer(timer, limit)
        answer = json.dumps(run_case(number))
        for timer in _TIMERS:
            signal.setitimer(timer, 0.0)
        print(answer, file=answers, flush=True)


def run_case(number: int) -> dict[str, object]:
    """Run a case and return its outcome."""
    folder = Path(tempfile.mkdtemp(prefix="attack-"))
    home = os.getcwd()
    os.chdir(folder)
    outcome: dict[str, object] = {"seed": number, "class": class_of(number)}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # A division by zero or an overflow inside the library is a failure.  Kernels that are
            # not compiled warn of those that they handle.
            if not numba.config.DISABLE_JIT:
                warnings.simplefilter("error", RuntimeWarning)
            outcome["what"] = run(number, folder)
        outcome["status"] = "ok"
    except Failure as failure:
        cause = failure.__cause__
        outcome |= {"status": "failed", "what": str(failure)}
        if cause is not None:
            outcome["where"] = "".join(traceback.format_exception(cause))[-2500:]
    except Exception as error:
        text = "".join(traceback.format_exception(error))[-2500:]
        outcome |= {"status": "broken", "what": f"the attack itself: {error!r}", "where": text}
    finally:
        os.chdir(home)
        with contextlib.suppress(OSError):
            shutil.rmtree(folder, ignore_errors=True)
    return outcome


if __name__ == "__main__":
    main()
