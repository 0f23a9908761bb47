"""A limit on the processor time of a child process."""

import math
import time
from importlib.util import find_spec


def limit_processor_time(seconds: float) -> None:
    """Have the system end this process after so many more seconds of processor time.

    Windows has no such limit.
    """
    if find_spec("resource") is None:
        return
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    used = time.process_time()
    limit = math.ceil(used + seconds)
    resource.setrlimit(resource.RLIMIT_CPU, (limit, hard))
