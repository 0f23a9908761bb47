"""Without numba, numbers of 64 bits wrap around with a warning, as they should without."""

import numpy as np
import pytest


@pytest.fixture(autouse=True)
def wrap_around():
    with np.errstate(over="ignore"):
        yield
