"""Functions that misbehave as mesh generators do, run in child processes.

They import nothing of adaptsize, so that a child starts quickly.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np


def crash(arrays, options):
    print("about to crash", flush=True)
    os.kill(os.getpid(), signal.SIGSEGV)


def abort(arrays, options):
    os.abort()


def hang(arrays, options):
    """Write the process's number where the test finds it, then ignore every polite signal."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    Path(options["pid_file"]).write_text(f"{os.getpid()} {child.pid}")
    time.sleep(60)


def killed(arrays, options):
    """Die as by the kernel's out-of-memory killer."""
    os.kill(os.getpid(), signal.SIGKILL)


def leave_children(arrays, options):
    """Finish at once, and leave processes behind: one in a group of its own."""
    sleep = "import os, time; {}time.sleep(60)"
    plain = subprocess.Popen([sys.executable, "-c", sleep.format("")])
    grouped = subprocess.Popen([sys.executable, "-c", sleep.format("os.setpgrp(); ")])
    time.sleep(1.0)
    Path(options["pid_file"]).write_text(f"{plain.pid} {grouped.pid}")
    return copy(arrays, options)


def hang_with_stray(arrays, options):
    """Hang, with a child that has left the session."""
    sleep = [sys.executable, "-c", "import time; time.sleep(60)"]
    stray = subprocess.Popen(sleep, start_new_session=True)
    Path(options["pid_file"]).write_text(f"{os.getpid()} {stray.pid}")
    time.sleep(60)


def crash_with_stray(arrays, options):
    """Crash, with a child that has left the session and does not end."""
    sleep = [sys.executable, "-c", "import time; time.sleep(60)"]
    stray = subprocess.Popen(sleep, start_new_session=True)
    Path(options["pid_file"]).write_text(f"{os.getpid()} {stray.pid}")
    os.kill(os.getpid(), signal.SIGSEGV)


def chatter(arrays, options):
    while True:
        print("x" * 100_000)


def fail(arrays, options):
    print("first the reason on the terminal")
    raise RuntimeError("no luck")


def leave_early(arrays, options):
    os._exit(3)


def litter(arrays, options):
    Path("__litter__.stl").write_text("solid")
    print("noise on stdout")
    print("noise on stderr", file=sys.stderr)
    return copy(arrays, options)


def copy(arrays, options):
    return {"points": arrays["points"], "cells": arrays["cells"]}


def empty(arrays, options):
    return {"points": arrays["points"], "cells": np.empty((0, 4), np.int32)}


def not_finite(arrays, options):
    return {"points": arrays["points"] * np.nan, "cells": arrays["cells"]}


def one_far_away(arrays, options):
    """Return one sound tetrahedron, 100 units away."""
    points = np.vstack([np.zeros(3), np.eye(3)]) + 100.0
    return {"points": points, "cells": np.array([[0, 1, 2, 3]], np.int32)}


def one_of_all(arrays, options):
    """Return one cell of the mesh that touches all sides of its bounding box."""
    points = arrays["points"]
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1]])
    return {"points": low + corners * (high - low), "cells": np.array([[0, 2, 1, 3]], np.int32)}


def without_first_cells(arrays, options):
    """Leave out the cells on one side of the middle."""
    points, cells = arrays["points"], arrays["cells"]
    middle = 0.5 * (points[:, 0].min() + points[:, 0].max())
    keep = points[cells].mean(axis=1)[:, 0] > middle
    return {"points": points, "cells": cells[keep]}


def shrunk(arrays, options):
    """Move the boundary inwards by one percent of the extent."""
    points = arrays["points"]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return {"points": middle + 0.98 * (points - middle), "cells": arrays["cells"]}


def doubled(arrays, options):
    """Return each cell twice, with nodes of its own."""
    n = len(arrays["points"])
    points = np.concatenate([arrays["points"]] * 2)
    return {"points": points, "cells": np.concatenate([arrays["cells"], arrays["cells"] + n])}


def one_twice(arrays, options):
    """Return a cell at the boundary twice, the second time with nodes of its own."""
    points, cells = arrays["points"], arrays["cells"]
    low, high = points.min(axis=0), points.max(axis=0)
    outside = ((points == low) | (points == high)).any(axis=1)
    corners = points[cells[outside[cells].all(axis=1)][0]]
    new = len(points) + np.arange(4)
    return {"points": np.concatenate([points, corners]), "cells": np.vstack([cells, new])}


def one_inverted(arrays, options):
    cells = arrays["cells"].copy()
    cells[0, :2] = cells[0, 1::-1]
    return {"points": arrays["points"], "cells": cells}
