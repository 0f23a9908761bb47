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
def test_functions_are_fields_of_a_loop():
    assert _run(1, "tests/with_dolfinx/check_functions.py").strip() == "all right"


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("dim", "cycles"), [(2, 5), (3, 2)])
def test_conditions_and_materials_stay_in_a_loop_on_two_ranks(dim, cycles):
    text = _run(2, "tests/with_dolfinx/check_conditions.py", dim, cycles)
    assert text.strip().endswith("all right")


@pytest.mark.timeout(1800)  # compiles forms and kernels on first use
@pytest.mark.parametrize(
    ("options", "dim"),
    [(["--cycles", "5"], 2), (["--space", "--cycles", "2", "--first", "1500"], 3)],
)
def test_loop_converges_as_in_serial(dim, options):
    ends = []
    for n_ranks in (1, 2):
        text = _run(n_ranks, "examples/with_dolfinx/corner_loop.py", *options)
        rows = [tuple(map(float, row)) for row in re.findall(r"(\d+) cells, error (\S+)", text)]
        (n0, e0), (n1, e1) = rows[1], rows[-1]
        # The best rates of linear elements with isotropic cells: 1/2, and 1/3 at an edge in space.
        assert (e0 / e1) > 0.95 * (n1 / n0) ** (1.0 / dim)
        # Straight boundaries are kept.
        assert max(map(float, re.findall(r"boundary within (\S+)", text))) < 1e-12
        ends.append((e1, e1 * n1 ** (1.0 / dim)))
    assert ends[1] == pytest.approx(ends[0], rel=0.02)  # also at the same number of cells
