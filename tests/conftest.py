"""Settings of the test run."""

import gc
import os
import signal
import sys

import pytest
from hypothesis import settings

# Shells start jobs in the background deaf to Ctrl-C; so would be the children that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# Likewise nohup and SIGHUP. Here it is caught without effect, as what is caught is not inherited.
if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda *_: None)

# No doctests in fixtures: two modules named conftest cannot be imported.
collect_ignore_glob = ["*conftest.py"]
# Programs that tests run in processes of their own.
collect_ignore = [
    "distributed/rank_program.py",
    "with_dolfinx/check_adapters.py",
    "with_dolfinx/check_conditions.py",
    "with_dolfinx/check_functions.py",
]
# Programs that our files are for, most of which are not packages of Python: see `make targets`.
if not os.environ.get("ADAPTSIZE_TARGETS"):
    collect_ignore.append("targets")

# No windows, where there is a display.
os.environ["PYVISTA_OFF_SCREEN"] = "true"

settings.register_profile("ci", derandomize=True, deadline=None, max_examples=20)
settings.register_profile("random", deadline=None, max_examples=300)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


def pytest_collection_finish():
    """Leave half a million objects of the collection out of each search for cyclic garbage."""
    gc.freeze()


#: Folders whose tests compile most: those about limiting first, those about remeshing last.  Files
#: that take a minute stand before small ones, so that no process is left with one at the end.
_FIRST = ("limiting", "laws", "order", "distributed", "kernels", "metrics", "background")
_LAST = (
    *("examples", "plot", "cli", "attack", "test_types.py", "benchmarks", "test_docs.py"),
    *("quality", "sizes", "adaptation", "geometry", "domain_size", "remeshing"),
)


def place_of(scope):
    """Return the place of a file in the order of the tests: tests/limiting/test_sphere.py."""
    folder = scope.removeprefix("tests/").partition("/")[0]
    if folder in _FIRST:
        return _FIRST.index(folder) - len(_FIRST)
    return _LAST.index(folder) + 1 if folder in _LAST else 0


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """With --dist loadfile, let processes begin at opposite ends of the order of the files.

    They share the cache of compiled kernels.  Side by side in the same folder they would compile
    the same ones at the same time.
    """
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class FromBothEnds(LoadFileScheduling):
        """Gives the first files to every other process, and the last ones to the rest."""

        def _assign_work_unit(self, node):
            end = max if self.nodes.index(node) % 2 else min
            self.workqueue.move_to_end(end(self.workqueue, key=place_of), last=False)
            super()._assign_work_unit(node)

    return FromBothEnds(config, log)
