"""Commands in the process of the tests print no lines about their steps, however slow it is."""

import pytest


@pytest.fixture(autouse=True)
def no_lines_about_steps(monkeypatch):
    monkeypatch.setattr("adaptsize.cli.steps.PATIENCE", 1e6)
