"""The number of cores that this process may use, and how many processes want them."""

import math
import os
from functools import cache
from pathlib import Path


@cache
def cores() -> int:
    """Return the number of cores that this process may use.

    These are the cores of its affinity, and not more than the quota of its control group on Linux
    (version 2), rounded up: in a container with two of 64 cores, 64 threads would share the two.
    """
    affinity = getattr(os, "sched_getaffinity", None)
    allowed = len(affinity(0)) if affinity else os.cpu_count() or 1
    quota = _quota(Path("/proc/self/cgroup"), Path("/sys/fs/cgroup"))
    return allowed if quota >= allowed else max(1, math.ceil(quota))


def crowding() -> float:
    """Return how many processes compute or wait for each core, at least 1.

    It is the mean of the last minute, and 1 where the system does not say.
    """
    try:
        waiting = os.getloadavg()[0]
    except (AttributeError, OSError):  # not on Windows
        return 1.0
    return max(1.0, waiting / cores())


def _quota(groups: Path, mounted: Path) -> float:
    """Return the least quota of the control group of this process and of those around it."""
    try:
        lines = groups.read_text().splitlines()
    except (OSError, UnicodeDecodeError):  # another system
        return math.inf
    own = next((line[3:].lstrip("/") for line in lines if line.startswith("0::")), "")
    folder = mounted / own
    least = math.inf
    for one in [folder, *folder.parents]:
        try:
            quota, period = (one / "cpu.max").read_text().split()
            least = min(least, math.inf if quota == "max" else int(quota) / int(period))
        except (OSError, ValueError, ZeroDivisionError):  # no such group, or one without a quota
            pass
        if one == mounted:
            break
    return least
