"""The solution of the exact method, composed of those of components."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from adaptsize.limiting.exact.field import ComponentSolution
from adaptsize.limiting.problem import Solution
from adaptsize.typing import FloatArray, IntArray

UNFINISHED = (
    "the exact method stopped its search for paths over reflex edges with sizes still falling: "
    "some sizes are larger than the shortest paths allow"
)


class SolvedComponent(NamedTuple):
    """A component of the domain and its solution."""

    nodes: IntArray | slice
    """Its nodes in the background; ``slice(None)`` stands for all."""
    found: ComponentSolution


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactSolution(Solution):
    """Limited sizes, their sources, and which sizes are proved exact."""

    parts: list[SolvedComponent] = field(default_factory=list)
    """Components with a bound."""
    n_proved: int
    """Number of nodes whose size is proved exact."""
    largest_gap: float
    """Largest difference between a size that is not proved exact and its lower bound."""
    propagated: bool = False
    """Whether paths over the edges of a solid were propagated from node to node."""


def as_solution(h0: FloatArray, parts: list[SolvedComponent]) -> ExactSolution:
    """Return the solution composed of those of the components; elsewhere bounds are kept."""
    whole = next((found.h for nodes, found in parts if isinstance(nodes, slice)), None)
    flat = (h0.ravel() if whole is None else whole).copy()
    n_hidden, gap, n_entries = 0, 0.0, 0
    for nodes, found in parts:
        if whole is None:
            flat[nodes] = found.h
        n_entries += len(found.field.nodes)
        if found.proved is not None and found.lower is not None:
            hidden = ~found.proved
            n_hidden += int(np.count_nonzero(hidden))
            gap = max(gap, float((found.h - found.lower)[hidden].max(initial=0.0)))
    h, n_proved, unfinished = flat.reshape(h0.shape), flat.size - n_hidden, ""
    if not all(found.finished for _, found in parts):
        unfinished = UNFINISHED
    return ExactSolution(
        h,
        n_entries,
        0.0,
        unfinished,
        parts=parts,
        n_proved=n_proved,
        largest_gap=gap,
        propagated=any(found.propagated for _, found in parts),
    )
