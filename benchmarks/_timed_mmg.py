"""`adaptsize.remeshing.mmg.adapt` that writes down how long Mmg itself took; runs in the child."""

import os
import time


def adapt(arrays, options):
    """Call Mmg; append its processor time, and that of the whole child, to the file MMG_TIMES."""
    import mmgpy

    from adaptsize.remeshing import mmg

    kind = getattr(mmgpy, options["class"])
    took = []

    class Timed(kind):
        def remesh(self, **settings):
            start = time.process_time()
            super().remesh(**settings)
            took.append(time.process_time() - start)

    Timed.__name__ = kind.__name__
    setattr(mmgpy, options["class"], Timed)
    try:
        return mmg.adapt(arrays, options)
    finally:
        with open(os.environ["MMG_TIMES"], "a", encoding="utf-8") as file:
            file.write(f"{sum(took)}\n")
