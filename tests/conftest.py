"""Settings of the test run."""

import gc
import os
import signal
import sys

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
