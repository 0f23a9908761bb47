"""An attack on adaptsize: random calls and damaged files, each case in a child process.

    python -m tests.attack [--cases N] [--start N] [--only CLASS]
    python -m tests.attack --only sequences --start 0 --cases 1000
    python -m tests.attack --seed N

A case is a number.  It fixes the class of the case and its random choices, so that a failure is
reproduced by ``--seed`` and the number.  See `cases` for the classes.  Two of them run only on
request, since each case takes seconds: `sequences` of calls on one mesh, and commands that
`signals` stop.
"""

import sys
from pathlib import Path

# The references of the tests: exact sizes, shapes, misbehaving generators.
sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
