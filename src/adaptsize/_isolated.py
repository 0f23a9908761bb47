"""Children of this process that are isolated (``python -I``).

Modules in the working folder, which may come from others, are not imported.
"""

import os
import sys

#: Holds the folders from which an isolated child imports.  It ignores PYTHONPATH.
_PATH = "ADAPTSIZE_PATH"
_HEAD = f"import os, sys; sys.path[:] = os.environ[{_PATH!r}].split(os.pathsep)\n"


def isolated(program: str, *arguments: object) -> list[str]:
    """Return the command that runs a Python program with the `environment` of a child.

    Its output is not buffered, in the C library either: it may end without cleanup or by a signal.
    """
    return [sys.executable, "-I", "-u", "-c", _HEAD + program, *map(str, arguments)]


def environment() -> dict[str, str]:
    """Return the environment of a child that imports from the folders of this process.

    The working folder is not among them, even where this process imports from it, unless it holds
    this package.
    """
    try:
        here = os.getcwd()
    except OSError:  # it has been removed
        here = ""
    paths = {os.path.abspath(path): None for path in sys.path if path not in ("", here)}
    package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    return {**os.environ, _PATH: os.pathsep.join({**paths, package: None})}
