"""Progress: silence, callbacks, and the bar."""

import numpy as np
import pytest

from adaptsize._progress import Stage, reporting
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
