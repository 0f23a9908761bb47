"""The types that users of the package get: of names, options, results and methods.

Names of some packages are imported on first use, which type checkers cannot follow.  Their stubs
are generated: run this file as a script after a change of the public names.
"""

import importlib
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: Packages whose names are imported on first use.
LAZY = (
    "",
    *(".geometry", ".metrics", ".plot", ".quality", ".remeshing", ".reporting"),
)


def stub_of(package):
    """Return the stub of a package."""
    module = importlib.import_module(package)
    by_home = sorted((home, name) for name, home in module._HOMES.items())
    lines = [
        f'"""The names of `{package}` for type checkers; tests/test_types.py writes this file."""',
        "",
        *(f"from {package} import {name} as {name}" for name in getattr(module, "_SUBMODULES", ())),
        *(f"from {package}.{home} import {name} as {name}" for home, name in by_home),
        *(["", "__version__: str"] if "__version__" in module.__all__ else []),
        *("", "__all__ = [", *(f'    "{name}",' for name in sorted(module.__all__)), "]"),
    ]
    return "\n".join(lines) + "\n"


def path_of(package):
    return Path(importlib.import_module(package).__file__).with_suffix(".pyi")


if __name__ == "__main__":
    for lazy in LAZY:
        path_of(f"adaptsize{lazy}").write_text(stub_of(f"adaptsize{lazy}"), encoding="utf-8")
