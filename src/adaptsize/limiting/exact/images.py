"""Exact limiting of a periodic cell: the sources of the cell and their images."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.limiting.exact.api import (
    ExactSolution,
    Part,
    as_solution,
    slabs_of,
    solve_exact,
)
from adaptsize.limiting.exact.field import ExactField, Points
from adaptsize.limiting.exact.solve import Found
from adaptsize.limiting.exact.waves import Wave, sorted_wave
from adaptsize.limiting.exact.work import number_of_threads
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from adaptsize.limiting.periodic import Periodicity
    from adaptsize.limiting.problem import Problem


def solve_problem(background: SimplexMesh | CartesianGrid, problem: Problem) -> ExactSolution:
    """Return the exact solution, of a periodic domain or another."""
    solution = solve_exact(
        background,
        problem.h0,
        problem.slope,
        face_sources=problem.face_sources,
        threads=problem.threads,
        point_sources=problem.point_sources,
        report=problem.report,
    )
    periodicity = problem.periodicity
    return solution if periodicity is None else _with_images(solution, periodicity, problem)


def _with_images(
    solution: ExactSolution, periodicity: Periodicity, problem: Problem
) -> ExactSolution:
    r"""Return the exact solution of a periodic domain from that of its cell.

    Both the cell and the domain are convex, so that distances are straight and

    .. math:: h(x) = \min_L \min_y h_0(y) + g \, |x - y - L|

    with all translations L of the lattice.  Sources that another one in the cell makes unnecessary
    are unnecessary everywhere, so only images of the others are added.
    """
    if not periodicity.is_convex:
        raise ValueError(
            "periodic with method='exact' needs a convex cell whose images complete it to a convex "
            "domain; use method='fast-marching'"
        )
    (part,) = solution.parts
    found, domain = part.found, periodicity.domain
    images = _images(found, periodicity)
    if images is None:
        return solution
    field = ExactField(found.field.g, None, found.field.linear, list(found.field.waves))
    field.add(images)
    h, source = found.h.copy(), found.source.copy()
    how = (number_of_threads(problem.threads), problem.report)
    if isinstance(domain, CartesianGrid):
        for first, points in slabs_of(domain):
            last = first + len(points.places)
            field.lower_by_last(points, h[first:last], source[first:last], *how)
    else:
        assert isinstance(domain, SimplexMesh)
        points = Points(domain.points, along_curve(domain.points), np.empty(0, np.int32))
        field.lower_by_last(points, h, source, *how)
    h = periodicity.least(h)  # rounding may differ between paired nodes
    return as_solution(solution.h, [Part(None, Found(h, source, field))])


def _images(found: Found, periodicity: Periodicity) -> Wave | None:
    """Return the images of sources that may lower a size in the cell."""
    nodes = np.concatenate([wave.nodes for wave in found.field.waves])
    places = np.concatenate([wave.places for wave in found.field.waves])
    sizes = np.concatenate([wave.sizes for wave in found.field.waves])
    if len(nodes) == 0:
        return None
    box = np.stack([places.min(axis=1), places.max(axis=1)])
    least, largest, g = sizes.min(axis=1), float(found.h.max()), found.field.g
    lower, upper = _corners(periodicity.domain)
    tables, named = [], []
    for shift in periodicity.shifts():
        gap = np.maximum(0.0, np.maximum(box[0] + shift - upper, lower - box[1] - shift))
        reach = least + g * np.linalg.norm(gap, axis=1) < largest
        if reach.any():
            moved = (places[reach] + shift).reshape(int(reach.sum()), -1)
            tables.append(np.concatenate([moved, sizes[reach]], axis=1))
            named.append(nodes[reach])
    return sorted_wave(np.concatenate(tables), np.concatenate(named)) if tables else None


def _corners(domain: SimplexMesh | CartesianGrid) -> tuple[FloatArray, FloatArray]:
    if isinstance(domain, CartesianGrid):
        return domain.lower, domain.upper
    return domain.points.min(axis=0), domain.points.max(axis=0)
