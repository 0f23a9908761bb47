"""What a finite element method costs on a mesh with given sizes, before that is made."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np

from adaptsize._checks import as_number, as_whole_number, check_type, describe, place_text, refusal
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import NONE, SizeReport
from adaptsize.background import SimplexMesh
from adaptsize.sizes.budget import nodes_of
from adaptsize.sizes.prediction import Prediction

_MEMORY = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*([KMGT]?)B?\s*", re.IGNORECASE)


class SmallPlace(NamedTuple):
    """A place where the size is small."""

    point: tuple[float, ...]
    size: float
    bound: str
    """What controls the size there, as in `SizeReport.causes`."""


@dataclass(frozen=True)
class Cost:
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


def report_of(size: SizeFunction) -> SizeReport:
    """Return the report of a result of `size_function`."""
    check_type("size", size, SizeFunction)
    if size.report is None:
        raise ValueError("size must be a result of size_function, with a report; got one without")
    return size.report


def simplices_of(dim: int, predicted: Prediction) -> tuple[float, ...]:
    """Return the numbers of nodes, edges ... cells, by Euler's formula without its constant.

    Where the facets of the boundary are not known, they are not counted.
    """
    cells, facets, nodes = predicted
    if np.isnan(nodes):
        facets, nodes = 0.0, nodes_of(dim, cells, 0.0)
    if dim == 1:
        return nodes, cells
    if dim == 2:
        return nodes, 1.5 * cells + 0.5 * facets, cells
    triangles = 2.0 * cells + 0.5 * facets
    return nodes, nodes + triangles - cells, triangles, cells


def unknowns_of(simplices: Sequence[float], degree: int) -> float:
    """Return the number of nodes of Lagrange elements, from the numbers of nodes, edges ..."""
    return sum(n * comb(degree - 1, k) for k, n in enumerate(simplices))


def nonzeros_of(simplices: Sequence[float], degree: int) -> float:
    r"""Return the number of ordered pairs of nodes of Lagrange elements with a cell in common.

    Each pair is counted at the smallest simplex that holds both.  A simplex of dimension k holds
    :math:`m_k = \binom{p + k}{k}` nodes, so by inclusion and exclusion
    :math:`\sum_j (-1)^{k - j} \binom{k + 1}{j + 1} m_j^2` pairs that none of its facets holds.
    """
    total = 0.0
    for k, n in enumerate(simplices):
        pairs = [
            (-1) ** (k - j) * comb(k + 1, j + 1) * comb(degree + j, j) ** 2 for j in range(k + 1)
        ]
        total += n * sum(pairs)
    return total


def matrix_of(dim: int, predicted: Prediction, degree: int, components: int) -> tuple[float, float]:
    """Return the number of unknowns, and the bytes of the assembled matrix.

    The matrix is stored by rows, with the integers that SciPy takes for indices.  All components
    at the nodes of a cell are coupled.
    """
    simplices = simplices_of(dim, predicted)
    unknowns = components * unknowns_of(simplices, degree)
    nonzeros = components**2 * nonzeros_of(simplices, degree)
    index = 4.0 if nonzeros < 2.0**31 else 8.0
    return unknowns, (8.0 + index) * nonzeros + index * (unknowns + 1.0)


def system_of(report: SizeReport, degree: int, components: int) -> tuple[float, float]:
    """Return the same for the mesh that a report predicts."""
    predicted = Prediction(report.n_elements, report.n_facets, report.n_nodes)
    return matrix_of(report.element_dim, predicted, degree, components)


def unknowns_on(mesh: SimplexMesh, degree: int, components: int) -> float:
    """Return the number of unknowns on a mesh."""
    inner = {1: [], 2: [len(mesh.edges)], 3: [len(mesh.edges), len(mesh.facets)]}[mesh.cell_dim]
    return components * unknowns_of([mesh.n_points, *inner, mesh.n_cells], degree)


def as_bytes(memory: str) -> float:
    """Return the number of bytes that a text such as "8GB" stands for."""
    found = _MEMORY.fullmatch(memory) if isinstance(memory, str) else None
    number = float(found[1]) if found else 0.0
    if found is None or number == 0.0:
        wanted = 'must be a text such as "8GB" or "500MB"'
        raise refusal("max_memory", f"{wanted}, got {describe(memory)}")
    return number * 1000.0 ** " KMGT".index(found[2].upper() or " ")
