"""The benchmark of distributed limiting, in a small form on one and two ranks."""

import re
from pathlib import Path

import pytest
from real_ranks import numbers_of_ranks, run_on_ranks

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "distributed.py"
ROW = re.compile(
    r"(\d) ranks, (square|cube), \d+ nodes, (two points|field), (first call|later calls): "
    r"cpu [\d.]+ s, wall [\d.]+ s, work ([\d.]+) s, (\d+) bytes"
)


@pytest.mark.parametrize("n_ranks", numbers_of_ranks()[:2])
def test_each_problem_gets_a_row_for_first_and_later_calls(n_ranks):
    ended = run_on_ranks(n_ranks, SCRIPT, "--nodes", "4000")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    rows = [ROW.fullmatch(line) for line in ended.stdout.splitlines()]
    assert all(rows), ended.stdout
    assert len({row.groups()[1:4] for row in rows}) == len(rows) == 8
    assert {int(row[1]) for row in rows} == {n_ranks}
    assert all(float(row[5]) > 0.0 for row in rows)
    # Only a field, and what is found of a new mesh, is exchanged.
    sent = {row.groups()[1:4]: int(row[6]) > 0 for row in rows}
    assert not sent["cube", "two points", "later calls"]
    assert sent["cube", "field", "later calls"] == (n_ranks > 1)
