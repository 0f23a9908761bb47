"""docs/parameters.md: the options are those declared, the sources those of both languages."""

import importlib
import inspect
import re
from pathlib import Path

import adaptsize as ads
from adaptsize.cli.sources import parse_source

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "parameters.md").read_text(encoding="utf-8")


def test_the_page_is_what_the_declarations_give(monkeypatch):
    monkeypatch.syspath_prepend(DOCS / "_ext")
    assert importlib.import_module("parameters").with_tables(TEXT) == TEXT


def test_sources_are_those_of_both_languages():
    sources = re.findall(r"^\| `(\w+)\((.*)\)` \| `(.*?)` \|", TEXT, re.MULTILINE)
    assert len(sources) == 6
    for name, parameters, shell in sources:
        source = getattr(ads, name)
        assert list(inspect.signature(source).parameters) == parameters.split(", ")
        assert isinstance(parse_source(shell), source)
