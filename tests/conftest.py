"""Settings of the test run."""

import os
import signal
import zlib
from pathlib import Path

from hypothesis import settings

# numba's cache does not see edits in an imported kernel: one cache per state of the kernels.
_ROOT = Path(__file__).parent.parent
_KERNELS = b"".join(p.read_bytes() for p in sorted(_ROOT.glob("src/adaptsize/_kernels/*.py")))
_CACHE = _ROOT / ".numba_cache" / f"{zlib.crc32(_KERNELS):08x}"
os.environ.setdefault("NUMBA_CACHE_DIR", str(_CACHE))

# Shells start jobs in the background deaf to Ctrl-C; so would be the children that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("ci", derandomize=True, deadline=None, max_examples=60)
settings.register_profile("random", deadline=None, max_examples=300)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))
