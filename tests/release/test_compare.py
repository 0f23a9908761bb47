"""The comparison of two commits: order of the runs, and ratios of pairs."""

import importlib.util
from pathlib import Path

import pytest

PATH = Path(__file__).parents[2] / "benchmarks" / "compare.py"


@pytest.fixture
def script():
    spec = importlib.util.spec_from_file_location("compare_commits", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_ratios_are_of_pairs_and_the_order_alternates(script):
    # The load doubles from round to round; "new" takes half as long.
    runs = []

    def measure(source, only):
        runs.append(source)
        load = 2.0 ** max((len(runs) - 3) // 2, 0)
        return {"a": load * (1.0 if source == "old" else 0.5), "b": None}

    rows = script.compare(["old", "new"], 4, "", measure)
    assert runs == ["old", "new", "old", "new", "new", "old", "old", "new", "new", "old"]
    assert rows == [("a", 1.0, 0.5, [0.5] * 4)]


def test_a_case_that_a_commit_lacks_does_not_stop_the_others(script, monkeypatch):
    monkeypatch.setattr(script, "CASES", {"fails": lambda: 1 / 0, "works": lambda: lambda: None})
    monkeypatch.setattr(script, "SECONDS", 0.01)
    found = script.measured("")
    assert found["fails"] is None
    assert found["works"] >= 0.0
