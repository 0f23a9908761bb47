"""Adapters and runs of mesh generators that misbehave, or that record what they are given."""

from contextlib import contextmanager
from dataclasses import dataclass, field

from adaptsize.errors import BackendError
from adaptsize.remeshing import register_backend, registry
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.protocol import Backend


@dataclass(frozen=True)
class FakeBackend(Backend):
    """Does whatever ``function`` of `misbehaving` does, and knows no tags."""

    function: str
    options: tuple = ()
    name: str = "fake"
    package: str = "numpy"
    install: str = "pip install fake"
    tasks: frozenset = frozenset({"tetrahedra"})

    def solve(self, problem, run):
        return run(
            f"misbehaving:{self.function}",
            "faking",
            {"points": problem.mesh.points, "cells": problem.mesh.cells},
            dict(self.options),
        )


class Recording(Backend):
    """A registered generator that keeps the problems that it is given, and may fail each time."""

    def __init__(self, name, *, fails=False):
        self._backend, self._fails = registry.available_backends()[name], fails
        self.problems = []
        for attribute in ("name", "package", "install", "tasks", "keeps_required_facets",
                          "needs_volume", "follows_metrics"):  # fmt: skip
            setattr(self, attribute, getattr(self._backend, attribute))

    def solve(self, problem, run):
        self.problems.append(problem)
        if self._fails:
            raise BackendError(f"{self.name} failed")
        return self._backend.solve(problem, run)


@contextmanager
def registered(*backends):
    """Register generators until the end of the block."""
    before = registry.available_backends()
    try:
        for backend in backends:
            register_backend(backend)
        yield
    finally:
        registry._BACKENDS.clear()
        registry._BACKENDS.update(before)


@dataclass(frozen=True)
class RecordingRunner(IsolatedRunner):
    """Keeps what is run in child processes, and fails instead where a name is among ``failing``.

    The name is that of the function, or the task of Mmg's program.
    """

    failing: tuple = ()
    jobs: list = field(default_factory=list)
    """For each run its name, the arrays and the limit of processor time."""

    @classmethod
    def without(cls, *failing):
        return cls("recording", None, None, lambda *_: None, failing=failing)

    def __call__(self, job, text, arrays, options):
        name = job.rpartition(".")[2] if isinstance(job, str) else options["task"]
        self.jobs.append((name, arrays, self.seconds))
        if name in self.failing:
            raise BackendError(f"{self.backend} failed")
        return super().__call__(job, text, arrays, options)

    def arrays(self, name):
        return [arrays for called, arrays, _ in self.jobs if called == name]
