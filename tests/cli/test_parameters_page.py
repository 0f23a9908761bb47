"""docs/parameters.md: names, defaults and options are those of the code."""

import inspect
import re
from pathlib import Path

import pytest
import typer

import adaptsize as ads
from adaptsize.cli.commands import app
from adaptsize.cli.sources import parse_source
from adaptsize.options import SizeFunctionOptions, options_of

TEXT = (Path(__file__).parents[2] / "docs" / "parameters.md").read_text(encoding="utf-8")
#: Function, commands, and whether the table has all parameters.
SECTIONS = {
    "Sizes of a domain": (ads.size_function, ("size", "remesh"), True),
    "Gradient limiting": (ads.limit_gradient, ("limit",), False),
    "Remeshing": (ads.remesh, ("remesh",), True),
    "Adaptive loops": (ads.adapt, ("adapt",), False),
}
#: Defaults of `size_function` that depend on other parameters.
CHOSEN = {name: option.chosen for name, option in options_of(SizeFunctionOptions).items()} | {
    "background": "depends on the domain"
}


def rows(section):
    """Return the cells of the table of a section, without its head."""
    part = TEXT.split(f"\n## {section}\n")[1].split("\n## ")[0]
    lines = [line for line in part.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in line[1:-1].split("|")] for line in lines]


@pytest.mark.parametrize("section", SECTIONS)
def test_names_and_defaults_are_those_of_the_function(section):
    function, _, is_complete = SECTIONS[section]
    parameters = inspect.signature(function).parameters
    listed = []
    for name_cell, _, default, _ in rows(section):
        name = re.match(r"`(\w+)`", name_cell)[1]
        listed.append(name)
        value = parameters[name].default
        if function is ads.size_function and CHOSEN.get(name):
            assert value is None, name
            assert default == CHOSEN[name], name
        elif value is inspect.Parameter.empty:
            assert default == "required"
        elif value in (None, ()) and default == "none":
            pass
        elif isinstance(value, int | float) and not isinstance(value, bool):
            assert float(default) == value, name
        else:
            assert default == str(value), name
    optional = [n for n, p in parameters.items() if p.default is not p.empty]
    assert not is_complete or set(listed) == set(optional)


@pytest.mark.parametrize("section", SECTIONS)
def test_options_exist(section):
    commands = typer.main.get_command(app).commands
    options = set()
    for command in SECTIONS[section][1]:
        for parameter in commands[command].params:
            options |= set(parameter.opts)
    for _, cell, _, _ in rows(section):
        for option in re.findall(r"`(-[^`]*)`", cell):
            assert option in options, option


def test_sources_are_those_of_both_languages():
    for python, shell, _ in rows("Sources"):
        call = re.match(r"`(\w+)\((.*)\)`", python)
        if call is None:
            continue
        source = getattr(ads, call[1])
        assert list(inspect.signature(source).parameters) == call[2].split(", ")
        assert isinstance(parse_source(shell.strip("`")), source)
