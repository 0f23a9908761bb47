"""Progress of gradient limiting, and how it is stopped."""

import signal
import subprocess
import sys

import numpy as np
import pytest
from meshes import jittered_square

from adaptsize import limit_gradient


def _long_problem():
    mesh = jittered_square(250, seed=93)
    h0 = np.full(mesh.n_points, np.inf)
    h0[0] = 0.1
    return mesh, h0


def test_progress_is_reported_and_ends_at_one():
    reports = []
    limit_gradient(
        *_long_problem(), 0.3, progress=lambda text, share: reports.append((text, share))
    )
    shares = [share for _, share in reports]
    assert len(reports) >= 2
    assert {text for text, _ in reports} == {"limiting the gradient"}
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < shares[-1] == 1.0


INTERRUPTED = """
import numpy as np
from meshes import jittered_square
from adaptsize import limit_gradient
from adaptsize.limiting import PositiveCoefficient

mesh = jittered_square(30, seed=94)
h0 = np.full(mesh.n_points, np.inf)
h0[0] = 0.1
limit_gradient(mesh, h0, 0.3, method=PositiveCoefficient(floor=None))
try:
    print("ready", flush=True)  # the signal may come from here on
    for _ in range(100_000):
        limit_gradient(mesh, h0, 0.3, method=PositiveCoefficient(floor=None, tol=1e-30))
except KeyboardInterrupt:
    h = limit_gradient(mesh, h0, 0.3)
    print("alive", h.shape[0], flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT cannot be sent to one process there")
def test_ctrl_c_stops_a_long_run_and_python_lives_on():
    from pathlib import Path

    child = subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", INTERRUPTED],
        cwd=Path(__file__).parents[1] / "support",
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert child.stdout.readline() == "ready\n"
        child.send_signal(signal.SIGINT)
        out, _ = child.communicate(timeout=60)
    finally:
        child.kill()
    assert out == "alive 900\n"
    assert child.returncode == 0
