"""What a finite element method costs on a mesh with given sizes, before that is made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adaptsize._checks import as_number, as_whole_number, place_text
from adaptsize._printed import Printed
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import NONE, SizeReport
from adaptsize.domain_size.reports import report_of
from adaptsize.domain_size.unknowns import system_of


class SmallPlace(NamedTuple):
    """A place where the size is small."""

    point: tuple[float, ...]
    size: float
    bound: str
    """What controls the size there, as in `SizeReport.causes`."""


@dataclass(frozen=True)
class Cost(Printed):
    """The predicted cost of a finite element method on a mesh, and what causes it."""

    degree: int
    components: int
    n_elements: float
    n_unknowns: float
    matrix_bytes: float
    """Memory of the assembled matrix, in compressed rows of float64, all components coupled."""
    element_shares: dict[str, float]
    """Share of the elements that each bound causes."""
    time_steps: dict[str, float]
    """Time in which a signal crosses the smallest element that each bound causes."""
    places: tuple[SmallPlace, ...]
    """The five smallest sizes that are farther apart than 5 % of the diagonal."""

    def __str__(self) -> str:
        """Return one line on the system, and one per bound and place."""
        plural = "s" if self.components > 1 else ""
        lines = [
            f"{self.n_unknowns:.3g} unknowns (degree {self.degree}, {self.components} "
            f"component{plural}), matrix of {self.matrix_bytes / 1e9:.3g} GB, "
            f"time step {self.time_step:.3g}"
        ]
        lines += [
            f"{name} costs {share:.1%} of the elements, time step {self.time_steps[name]:.3g}"
            for name, share in sorted(self.element_shares.items(), key=lambda item: -item[1])
            if share > 0.0
        ]
        lines += [
            f"size {place.size:.4g} at {place_text(place.point, 4)}, from {place.bound}"
            for place in self.places
        ]
        return "\n".join(lines)

    @property
    def time_step(self) -> float:
        """The smallest of `time_steps`."""
        return min(self.time_steps.values())


def cost(size: SizeFunction, *, degree: int = 1, components: int = 1, speed: float = 1.0) -> Cost:
    """Return what a finite element method costs on a mesh with these sizes.

    See `SizeFunction.cost`.
    """
    report = report_of(size)
    degree = as_whole_number("degree", degree, lower=1, upper=20)
    components = as_whole_number("components", components, lower=1, upper=1000)
    speed = as_number("speed", speed, lower=0.0, strict=True)
    unknowns, memory = system_of(report, degree, components)
    shares = {name: share for name, share in report.element_shares.items() if share > 0.0}
    return Cost(
        degree=degree,
        components=components,
        n_elements=report.n_elements,
        n_unknowns=unknowns,
        matrix_bytes=memory,
        element_shares=shares,
        time_steps={name: report.smallest[name] / speed for name in shares},
        places=_small_places(size, report),
    )


def _small_places(size: SizeFunction, report: SizeReport) -> tuple[SmallPlace, ...]:
    """Return the places of the smallest sizes in the domain."""
    cause = report.cause.ravel()
    inside = np.flatnonzero(cause != NONE)
    h, points = np.asarray(size.values).ravel()[inside], size.background.points[inside]
    found: list[SmallPlace] = []
    free = np.ones(len(inside), np.bool_)
    while free.any() and len(found) < 5:
        least = int(np.argmin(np.where(free, h, np.inf)))
        where = tuple(points[least].tolist())
        found.append(SmallPlace(where, float(h[least]), report.causes[cause[inside[least]]]))
        away = np.linalg.norm(points - points[least], axis=1)
        free &= away > 0.05 * size.background.diagonal
    return tuple(found)
