"""Progress: silence, callbacks, and the bar."""

import numpy as np
import pytest

from adaptsize._progress import reporting


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
