"""What the benchmarks of surfaces share: limited children, and outcomes that a later run finds."""

import contextlib
import json
import os
import signal
import time


def wait(child, seconds):
    """Return the exit code and the use of a child; end it and its group after some seconds."""
    end = time.monotonic() + seconds
    while True:
        pid, status, usage = os.wait4(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status), usage
        if time.monotonic() > end:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
        time.sleep(0.05)


def rows_in(store):
    """Return the rows of an earlier run; a line that was cut off is left out."""
    rows = []
    for line in store.read_text(encoding="utf-8").splitlines() if store.exists() else []:
        with contextlib.suppress(json.JSONDecodeError):
            rows.append(json.loads(line))
    return rows


def shown(value):
    """Return the text of a cell."""
    if isinstance(value, float):
        return f"{value:.3g}"
    return value[:160].replace("|", "/") if isinstance(value, str) else str(value)
