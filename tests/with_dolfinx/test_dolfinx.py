"""DOLFINx and PETSc: adapters, and an adaptive loop on one and two ranks (``make dolfinx``)."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest
from real_ranks import run_on_ranks

pytestmark = pytest.mark.skipif(
    find_spec("dolfinx") is None,
    reason="needs the package dolfinx-solver-real (Python >= 3.12); see make dolfinx",
)

ROOT = Path(__file__).parents[2]


def _run(n_ranks, script, *arguments):
    done = run_on_ranks(n_ranks, ROOT / script, *arguments, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("n_ranks", [1, 2])
def test_adapters(n_ranks):
    assert _run(n_ranks, "tests/with_dolfinx/check_adapters.py").strip() == "all right"


@pytest.mark.timeout(1800)  # compiles forms and kernels on first use
def test_loop_converges_as_in_serial():
    found = []
    for n_ranks in (1, 2):
        text = _run(n_ranks, "examples/with_dolfinx/corner_loop.py", "--cycles", "5")
        found.append(
            [tuple(map(float, row)) for row in re.findall(r"(\d+) cells, error (\S+)", text)]
        )
    for rows in found:
        (n0, e0), (n1, e1) = rows[-3], rows[-1]
        assert (e0 / e1) > 0.95 * (n1 / n0) ** 0.5  # the best rate of linear elements
    # Errors at the same number of cells.
    ends = [error * n_cells**0.5 for n_cells, error in (rows[-1] for rows in found)]
    assert ends[1] == pytest.approx(ends[0], rel=0.02)
