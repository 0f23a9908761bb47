"""What a mesh with given sizes costs before it is made, and the sizes of each part of a domain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from adaptsize._checks import as_number, as_whole_number, check_type, place_text
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import NONE, SizeReport, measure_dim
from adaptsize.background import SimplexMesh
from adaptsize.domain_size.matrix import system_of
from adaptsize.domain_size.named_parts import parts_of
from adaptsize.sizes.budget import nodal_measures
from adaptsize.typing import FloatArray


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
    fields: int
    n_elements: float
    n_unknowns: float
    matrix_bytes: float
    """Memory of the assembled matrix, in compressed rows of float64, all fields coupled."""
    element_shares: dict[str, float]
    """Share of the elements that each bound causes."""
    time_steps: dict[str, float]
    """Time in which a signal crosses the smallest element that each bound causes."""
    places: tuple[SmallPlace, ...]
    """The five smallest sizes that are farther apart than 5 % of the diagonal."""

    def __str__(self) -> str:
        """Return one line on the system, and one per bound and place."""
        plural = "s" if self.fields > 1 else ""
        lines = [
            f"{self.n_unknowns:.3g} unknowns (degree {self.degree}, {self.fields} field{plural}), "
            f"matrix of {self.matrix_bytes / 1e9:.3g} GB, time step {self.time_step:.3g}"
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


def cost(size: SizeFunction, *, degree: int = 1, fields: int = 1, speed: float = 1.0) -> Cost:
    """Return what a finite element method costs on a mesh with these sizes.

    Parameters
    ----------
    size : SizeFunction
        From `size_function`.
    degree : int
        Polynomial degree of Lagrange elements, 1 to 20.
    fields : int
        Number of unknown fields.
    speed : float
        Largest speed of a signal, in units of length per time.

    Returns
    -------
    Cost

    Raises
    ------
    ValueError
        If ``size`` has no report, or an option is out of range.

    Notes
    -----
    The numbers of nodes, edges, faces and cells follow from the predicted cells and boundary facets
    by Euler's formula.  The unknowns and the nonzeros of the matrix are those of a conforming mesh
    with these numbers, exactly.  For grids, octrees and images the facets of the boundary are not
    known and count as none.  An explicit method is stable up to a multiple of the time step that
    depends on the method and the degree.

    Examples
    --------
    >>> from adaptsize import SimplexMesh, size_function
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> size = size_function(square, hmax=0.01, hmin=0.01)
    >>> print(f"{size.cost(degree=2).n_unknowns:.2g}")
    4.7e+04
    """
    report = _report_of(size)
    degree = as_whole_number("degree", degree, lower=1, upper=20)
    fields = as_whole_number("fields", fields, lower=1, upper=1000)
    speed = as_number("speed", speed, lower=0.0, strict=True)
    unknowns, _, memory = system_of(report, degree, fields)
    shares = {name: share for name, share in report.element_shares.items() if share > 0.0}
    return Cost(
        degree=degree,
        fields=fields,
        n_elements=report.n_elements,
        n_unknowns=unknowns,
        matrix_bytes=memory,
        element_shares=shares,
        time_steps={name: report.smallest[name] / speed for name in shares},
        places=_small_places(size, report),
    )


def _report_of(size: SizeFunction) -> SizeReport:
    check_type("size", size, SizeFunction)
    if size.report is None:
        raise ValueError("size must be a result of size_function, with a report; got one without")
    return size.report


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
    """Distance of edges of that size, times sqrt 2, from an arc of the radius."""
    element_share: float
    """Share of the elements in a region; of those whose sizes grow from a face, nan if unknown."""
    time_step: float
    """Time in which a signal crosses an element of the smallest size."""


def parts(size: SizeFunction, *, speed: float = 1.0) -> tuple[Part, ...]:
    """Return the width, curvature, size and cost of each region and face of a domain.

    Regions are those of ``cell_tags`` of a mesh of full dimension.  Faces are those of
    ``tagged_facets`` there, and of ``cell_tags`` of a surface.  If there are no tags, faces are
    those of `SimplexMesh.tag_faces`, in the plane the lines between corners.

    Parameters
    ----------
    size : SizeFunction
        From `size_function` of a mesh, with the mesh or its surface as background.
    speed : float
        As in `SizeFunction.cost`.

    Returns
    -------
    tuple of Part
        Regions first, then faces, by tag.

    Raises
    ------
    ValueError
        If ``size`` has no report, or is on a grid or an octree.

    Notes
    -----
    Widths, separations and radii are those that bound the size, so they are known where these
    bounds are active.  A node on several faces counts for each; sizes that grow from it count for
    the smallest of them.

    Examples
    --------
    >>> from adaptsize import SimplexMesh, size_function
    >>> corners, facets = [[0, 0], [4, 0], [4, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]]
    >>> strip = SimplexMesh(corners, [[0, 1, 2], [0, 2, 3]], tagged_facets=facets,
    ...                     facet_tags=[1, 1, 1, 2], tag_names={(1, 2): "inlet"})
    >>> [(part.name, part.measure) for part in size_function(strip).parts()]
    [('face 1', 9.0), ('inlet', 1.0)]
    """
    report, mesh = _report_of(size), size.background
    speed = as_number("speed", speed, lower=0.0, strict=True)
    if not isinstance(mesh, SimplexMesh):
        raise ValueError(f"size must be on a mesh or a surface to have parts, got {size!r}")
    h = size.values
    elements = nodal_measures(mesh) / h ** measure_dim(mesh)
    diameter = mesh.diameter
    length = _lengths(report, diameter)
    found: list[Part] = []

    named = parts_of(mesh)
    owner = np.full(mesh.n_points, -1)
    faces = [k for k, part in enumerate(named) if part.kind == "face"]
    for k in sorted(faces, key=lambda k: -named[k].measures.sum()):
        owner[named[k].cells] = k
    caused = None if report.origin is None else np.append(owner, -1)[report.origin]
    density = (1.0 / h[mesh.cells] ** mesh.cell_dim).mean(axis=1)
    for k, part in enumerate(named):
        nodes = np.unique(part.cells)
        is_given = "size_of" in report.bounds and np.isfinite(report.bounds["size_of"][nodes]).all()
        shape = {} if is_given else length
        least = {name: float(values[nodes].min()) for name, values in shape.items()}
        smallest, radius = float(h[nodes].min()), least.get("radius", np.nan)
        share = np.nan
        if part.kind == "region":
            own = part.measures * (1.0 / h[part.cells] ** mesh.cell_dim).mean(axis=1)
            share = float(own.sum() / (mesh.measures * density).sum())
        elif caused is not None:
            share = float(elements[caused == k].sum() / elements.sum())
        found.append(
            Part(
                part.kind, part.tag, part.name, float(part.measures.sum()),
                least.get("width", np.nan), least.get("separation", np.nan), radius, smallest,
                smallest**2 / (4.0 * radius), share, smallest / speed,
            )
        )  # fmt: skip
    return tuple(found)


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
            chords = np.square(bound) / (4.0 * report.chord_tolerance * diameter)
            found["radius"] = np.fmax(report.elements_per_radian * bound, chords)
    return found
