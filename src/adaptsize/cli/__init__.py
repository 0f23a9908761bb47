"""The command line: ``adaptsize info | size | limit | remesh | adapt | image | check``."""

from adaptsize.cli.entry import main

__all__ = ["main"]
