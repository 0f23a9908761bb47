"""How the tests of the examples run them."""

import importlib.util
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Import an example by name, as if started in its folder, and call its main; it draws."""
    monkeypatch.syspath_prepend(str(EXAMPLES))

    def call(name, **settings):
        found = load(name).main(tmp_path, width=160, **settings)
        picture = name.removeprefix("plot_")
        assert (tmp_path / f"{picture}.png").stat().st_size > 2_000
        return found

    yield call
    sys.modules.pop("_gallery", None)


def load(name):
    spec = importlib.util.spec_from_file_location(f"example_{name}", EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
