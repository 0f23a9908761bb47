"""What determines the sizes in the regions and on the faces of a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from adaptsize._checks import as_number
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport
from adaptsize.background import SimplexMesh
from adaptsize.domain_size.named_parts import parts_of
from adaptsize.domain_size.parameters import chords_of
from adaptsize.domain_size.reports import report_of
from adaptsize.sizes.budget import mean_density
from adaptsize.typing import FloatArray


@dataclass(frozen=True)
class Part:
    """A region or a face of a domain, with what determines its mesh."""

    kind: Literal["region", "face"]
    tag: int
    name: str
    """Of the tag, else the kind and the tag."""
    measure: float
    """Length, area or volume."""
    width: float
    """Least width of the domain at it; inf where it is not narrow, nan where it is not known or
    the size is prescribed by ``size_of``."""
    separation: float
    """Least distance of features that do not meet; inf and nan as for the width."""
    radius: float
    """Least radius of curvature; inf where it is flat, nan where it is not known."""
    size: float
    """Smallest size on it."""
    tolerance: float
    """Distance of a regular triangle of that size from a sphere of the radius."""
    element_share: float
    """Share of the elements in a region; of those whose sizes grow from a face, nan if unknown."""
    time_step: float
    """Time in which a signal crosses an element of the smallest size."""


class Parts(tuple[Part, ...]):
    """The parts of a domain, shown as a table with a row for each."""

    __slots__ = ()

    def __repr__(self) -> str:
        return table_of(self)


def parts(size: SizeFunction, *, speed: float = 1.0) -> Parts:
    """Return the width, curvature, size and cost of each region and face of a domain.

    See `SizeFunction.parts`.
    """
    report, mesh = report_of(size), size.background
    speed = as_number("speed", speed, lower=0.0, strict=True)
    if not isinstance(mesh, SimplexMesh):
        raise ValueError(f"size must be on a mesh or a surface to have parts, got {size!r}")
    h = size.values
    elements = mesh.measures * mean_density(h[mesh.cells])
    diameter = mesh.diameter
    length = _lengths(report, diameter)
    found: list[Part] = []

    named = parts_of(mesh)
    owner = np.full(mesh.n_points, -1)
    faces = [k for k, part in enumerate(named) if part.kind == "face"]
    for k in sorted(faces, key=lambda k: -named[k].measures.sum()):
        owner[named[k].cells] = k
    caused = None if report.origin is None else np.append(owner, -1)[report.origin]
    for k, part in enumerate(named):
        nodes = np.unique(part.cells)
        is_given = "size_of" in report.bounds and np.isfinite(report.bounds["size_of"][nodes]).all()
        shape = {} if is_given else length
        least = {name: float(values[nodes].min()) for name, values in shape.items()}
        smallest, radius = float(h[nodes].min()), least.get("radius", np.nan)
        share = np.nan
        if part.kind == "region":
            own = part.measures * mean_density(h[part.cells])
            share = float(own.sum() / elements.sum())
        elif caused is not None:  # a cell gives each of its nodes the same share
            grown = (caused[mesh.cells] == k).mean(axis=1)
            share = float((elements * grown).sum() / elements.sum())
        found.append(
            Part(
                part.kind, part.tag, part.name, float(part.measures.sum()),
                least.get("width", np.nan), least.get("separation", np.nan), radius, smallest,
                smallest**2 / (chords_of(report.relaxation) * radius), share, smallest / speed,
            )
        )  # fmt: skip
    return Parts(found)


def table_of(found: Sequence[Part]) -> str:
    """Return a table with a row for each part."""
    names = ("measure", "width", "separation", "radius", "size", "tolerance", "time_step")
    rows = [("part", *(name.replace("_", " ") for name in names), "elements")]
    for part in found:
        values = (getattr(part, name) for name in names)
        numbers = ("-" if np.isnan(value) else f"{value:.4g}" for value in values)
        share = "-" if np.isnan(part.element_share) else f"{part.element_share:.1%}"
        rows.append((part.name, *numbers, share))
    width = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join([row[0].ljust(width[0]), *map(str.rjust, row[1:], width[1:])]) for row in rows
    )


def _lengths(report: SizeReport, diameter: float) -> dict[str, FloatArray]:
    """Return what the bounds at the nodes are found from: widths, separations and radii."""
    found = {}
    for name, number in (
        ("width", report.elements_across),
        ("separation", report.elements_between),
    ):
        if name in report.bounds and number > 0.0:
            found[name] = number * report.bounds[name]
    if "curvature" in report.bounds:
        bound = report.bounds["curvature"]
        with np.errstate(invalid="ignore"):  # a bound that is disabled says nothing about inf
            chords = np.square(bound) / (chords_of(report.relaxation) * report.tolerance * diameter)
            found["radius"] = np.fmax(report.elements_per_radian * bound, chords)
    return found
