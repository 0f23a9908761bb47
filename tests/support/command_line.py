"""The command line in the process of the tests."""

from adaptsize.cli.entry import run


def call(*arguments):
    """Run a command and return its exit code."""
    return run([str(word) for word in arguments])
