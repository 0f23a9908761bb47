"""An adapter of mesh generators that misbehave."""

from dataclasses import dataclass

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
