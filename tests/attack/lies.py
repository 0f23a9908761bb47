"""Mesh generators that return a wrong mesh without saying so; run in a child process."""

import sys
import time
from pathlib import Path

import fake_generators
import numpy as np

from adaptsize.errors import BackendError
from adaptsize.remeshing import register_backend, remesh

_ENDLESS = ("hang", "hang_with_stray", "chatter", "slow_and_large")


def remesh_with(name: str) -> str:
    """Return "made" or "refused", and what was made or why not."""
    sys.modules["lies"] = sys.modules[__name__]
    module = "lies" if name in globals() else "fake_generators"
    pid_file = str(Path("pids").resolve())
    register_backend(_backend(name, module, pid_file))
    timeout = 5.0 if name in _ENDLESS else 100.0
    try:
        mesh = remesh(_cube(), 0.5, target="tetrahedra", backend="fake", timeout=timeout)
    except (BackendError, ValueError) as error:
        return f"refused: {error}"
    return f"made: {mesh!r}"


def _backend(name, module, pid_file):
    class Lying(fake_generators.FakeBackend):
        def solve(self, problem, run):
            arrays = {"points": problem.mesh.points, "cells": problem.mesh.cells}
            made = run(f"{module}:{name}", "lying", arrays, dict(self.options))
            return fake_generators.RawMesh(made["points"], made["cells"])

    return Lying(name, (("pid_file", pid_file),))


def _cube():
    from adaptsize import SimplexMesh

    corners = np.array([[i, j, k] for i in (0.0, 1.0) for j in (0.0, 1.0) for k in (0.0, 1.0)])
    # Six tetrahedra around the diagonal from corner 0 to corner 7.
    cells = [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]]
    mesh = SimplexMesh(corners, cells)
    turned = mesh.signed_measures < 0.0
    outwards = np.where(turned[:, None], np.array(cells)[:, [1, 0, 2, 3]], cells)
    return SimplexMesh(corners, outwards)


def far_away(arrays, options):
    """One tetrahedron, a hundred units away."""
    corners = np.vstack([np.zeros(3), np.eye(3)]) + 100.0
    return {"points": corners, "cells": np.array([[0, 1, 2, 3]], np.int32)}


def one_of_them(arrays, options):
    return {"points": arrays["points"], "cells": arrays["cells"][:1]}


def half(arrays, options):
    return {"points": arrays["points"], "cells": arrays["cells"][::2]}


def shrunk(arrays, options):
    middle = arrays["points"].mean(axis=0)
    return {"points": middle + 0.8 * (arrays["points"] - middle), "cells": arrays["cells"]}


def moved(arrays, options):
    return {"points": arrays["points"] + 0.3, "cells": arrays["cells"]}


def doubled(arrays, options):
    return {"points": arrays["points"], "cells": np.concatenate([arrays["cells"]] * 2)}


def slow_and_large(arrays, options):
    time.sleep(60.0)


def wrong_names(arrays, options):
    return {"nodes": arrays["points"]}


def wrong_shapes(arrays, options):
    return {"points": arrays["points"][:, :1], "cells": arrays["cells"].ravel()}
