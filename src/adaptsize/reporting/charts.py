"""Histograms of a report, as SVG."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.quality.conformity import edge_ratios
from adaptsize.quality.elements import minimum_angles
from adaptsize.typing import FloatArray

#: Extents of a chart, and its margins at the left and below, in pixels.
_WIDTH, _HEIGHT, _LEFT, _BELOW = 480.0, 260.0, 60.0, 44.0


def histogram_of_lengths(mesh: SimplexMesh, size: SizeFunction) -> str:
    """Return the histogram of edge lengths over sizes, on a logarithmic axis."""
    ratio = edge_ratios(mesh, size)
    logs = np.log2(ratio[np.isfinite(ratio) & (ratio > 0.0)])
    ticks = [(power, f"{2.0**power:.3g}") for power in (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)]
    title = "edges by length over requested size (dashed: factor sqrt 2)"
    ends = np.linspace(-2.0, 2.0, 49)
    return _bars(np.clip(logs, -2.0, 2.0), ends, ticks, title, "edges", bounds=(-0.5, 0.5))


def histogram_of_angles(mesh: SimplexMesh) -> str:
    """Return the histogram of the smallest angles of the cells."""
    limit, kind = (75.0, "dihedral angle") if mesh.cell_dim == 3 else (61.0, "angle")
    angles = np.clip(minimum_angles(mesh), 0.0, limit)
    ticks = [(float(x), f"{x}") for x in range(0, int(limit), 10)]
    title = f"cells by smallest {kind}, degrees"
    return _bars(angles, np.arange(0.0, limit, 1.5), ticks, title, "cells")


def _bars(
    values: FloatArray,
    ends: FloatArray,
    ticks: Sequence[tuple[float, str]],
    title: str,
    counted: str,
    bounds: Sequence[float] = (),
) -> str:
    counts, _ = np.histogram(values, ends)
    most = max(int(counts.max()), 1)
    floor, top = _HEIGHT - _BELOW, 8.0

    def x_of(value: float) -> float:
        return float(_LEFT + (value - ends[0]) / (ends[-1] - ends[0]) * (_WIDTH - _LEFT - 8.0))

    def y_of(count: float) -> float:
        return floor - count / most * (floor - top)

    parts = [
        f'<rect x="{x_of(a) + 0.4:.1f}" y="{y_of(n):.1f}" width="{x_of(b) - x_of(a) - 0.8:.1f}" '
        f'height="{floor - y_of(n):.1f}"><title>{n} {counted}</title></rect>'
        for a, b, n in zip(ends[:-1], ends[1:], counts.tolist(), strict=True)
        if n
    ]
    parts += [
        f'<text x="{x_of(value):.1f}" y="{floor + 16}" text-anchor="middle">{text}</text>'
        for value, text in ticks
    ]
    parts += [
        f'<text x="{_LEFT - 6}" y="{y_of(n) + 4:.1f}" text-anchor="end">{n:.0f}</text>'
        for n in (0, most)
    ]
    parts += [
        f'<line class="bound" x1="{x_of(b):.1f}" x2="{x_of(b):.1f}" y1="{top}" y2="{floor}"/>'
        for b in bounds
    ]
    middle = (_WIDTH + _LEFT) / 2
    return (
        f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img"><title>{title}</title>'
        f'<line x1="{_LEFT}" x2="{_WIDTH - 8}" y1="{floor}" y2="{floor}"/>{"".join(parts)}'
        f'<text x="{middle}" y="{_HEIGHT - 8}" text-anchor="middle">{title}</text>'
        "</svg>"
    )
