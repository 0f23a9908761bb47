"""Progress: silence, callbacks, and the bar."""

import sys
import types

import numpy as np
import pytest

from adaptsize import CartesianGrid, _progress, check_mesh, size_function
from adaptsize._progress import Stage, TimeLeft, reporting
from adaptsize.cli.console import Console


@pytest.mark.parametrize("progress", [None, False, np.bool_(False)])
def test_nothing_is_printed_unless_requested(progress, capfd):
    with reporting(progress) as report:
        report("working", 0.5)
        report("working", None)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("error", [KeyboardInterrupt, LookupError])
@pytest.mark.parametrize("progress", [None, True, lambda text, share: None])
def test_exceptions_go_through(progress, error):
    def work():
        with reporting(progress) as report:
            report("working", 0.1)
            raise error

    with pytest.raises(error):
        work()


def test_stages_begin_parts_of_a_step_and_other_texts_do_not():
    console = Console()
    with console.steps(3) as steps:
        steps.begin("reading")
        report = steps.following()
        for text in (
            Stage("sizes"),
            "sizes",
            "filling the gaps with nodes",
            Stage("adapting", "Mmg"),
            Stage("adapting", "Mmg"),
        ):
            report(text, None)
        steps.begin("writing")
    names = [name for name, _ in console.times]
    assert names == ["reading", "sizes", "adapting with Mmg", "writing"]
    assert [name.generator for name in names if isinstance(name, Stage)] == ["", "Mmg"]


def test_the_time_left_counts_down_while_a_step_does_not_report():
    left = TimeLeft(0.0)
    assert left.update(30.0, "limiting", 0.25) == "about 90 s left"
    # The same share again and again: the last estimate counts down, and ends when it is over.
    shown = [left.update(now, "limiting", 0.25) for now in (60.0, 90.0, 119.0, 121.0)]
    assert shown == ["about 60 s left", "about 30 s left", "about 1 s left", ""]


def test_the_time_left_does_not_rise_a_little_but_does_if_a_step_is_much_slower():
    left = TimeLeft(0.0)
    left.update(50.0, "limiting", 0.5)
    assert left.update(60.0, "limiting", 0.58) == "about 40 s left"  # not 43
    assert left.update(100.0, "limiting", 0.6) == "about 67 s left"
    # Another text is another part of the work, with a share of its own.
    assert left.update(110.0, "width", 0.5) == "about 10 s left"


def test_a_notebook_shows_one_line_that_is_empty_at_the_end(monkeypatch, capfd):
    shown = []
    line = types.SimpleNamespace(update=lambda data, raw: shown.append(data["text/plain"]))
    module = types.ModuleType("IPython.display")
    module.display = lambda data, raw, display_id: line
    monkeypatch.setitem(sys.modules, "IPython", types.ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    monkeypatch.setattr(_progress, "_is_notebook", lambda: True)
    with reporting(True) as report:
        for k in range(1000):
            report("limiting", k / 1000)
        report("meshing", None)
    assert shown[0] == "limiting  0%"
    assert shown[-2:] == ["meshing", ""]
    assert len(shown) < 500
    assert capfd.readouterr() == ("", "")


def test_notebooks_show_what_print_does():
    shown = []
    printer = types.SimpleNamespace(text=shown.append)
    mesh = CartesianGrid([0, 0], 0.5, (3, 3)).mesh
    size = size_function(mesh, hmax=1.0)
    for one in (check_mesh(mesh), size.report, size.cost()):
        one._repr_pretty_(printer, cycle=False)
        assert shown[-1] == str(one)
        assert "(" not in shown[-1].split()[0]
