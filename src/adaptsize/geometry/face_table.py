"""What distinguishes the faces of a surface: area, extent and curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.topology import pairs_of_cells
from adaptsize.typing import FloatArray, IndexArray


@dataclass(frozen=True)
class FaceSummary:
    """A face of a surface.

    Parameters
    ----------
    name : str
    area : float
    low, high : FloatArray
        Corners of the box around it, float64[3].
    curvature : float
        Mean over the face of the sum of both principal curvatures: 0 where it is plane, 1 / R on a
        cylinder, 2 / R on a ball; positive where it is convex, if normals point outward.
    """

    name: str
    area: float
    low: FloatArray
    high: FloatArray
    curvature: float


def summarize_faces(surface: SimplexMesh) -> list[FaceSummary]:
    """Return the faces of a surface by its tags, in their order.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space with ``cell_tags``, as `tag_faces` returns them.

    Notes
    -----
    The angle between the normals of two triangles times the length of their edge is the integral
    of the curvature around it.  Half of each triangle at the rim of a face has no such edge in the
    face, so that the curvature of narrow faces of few triangles is too small.

    Examples
    --------
    >>> cube = SimplexMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], cell_tags=[4])
    >>> [(face.name, face.area, face.curvature) for face in summarize_faces(cube)]
    [('4', 0.5, 0.0)]
    """
    tags = surface.cell_tags
    if tags is None:
        raise ValueError("surface must have cell_tags: use tag_faces first")
    numbers, face = np.unique(tags, return_inverse=True)
    areas = np.bincount(face, weights=surface.measures)
    bent = np.bincount(face, weights=_bending(surface, face), minlength=len(numbers))
    found = []
    for k, tag in enumerate(numbers.tolist()):
        corners = surface.points[surface.cells[face == k]].reshape(-1, 3)
        found.append(
            FaceSummary(
                surface.tag_names.get((2, tag), str(tag)),
                float(areas[k]),
                corners.min(axis=0),
                corners.max(axis=0),
                float(bent[k] / areas[k]) if areas[k] > 0.0 else 0.0,
            )
        )
    return found


def _bending(surface: SimplexMesh, face: IndexArray) -> FloatArray:
    """Return for each triangle half of the integrals of curvature at its edges inside a face."""
    inner = surface.facet_cell_counts == 2
    pairs = pairs_of_cells(surface, inner)
    one, other = (pairs // 3).T
    same = face[one] == face[other]
    one, other = one[same], other[same]
    a, b, c = surface.points[surface.cells].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)  # only their angles are used
    middles = surface.points[surface.cells].mean(axis=1)
    turn = np.cross(normals[one], normals[other])
    angle = np.arctan2(np.linalg.norm(turn, axis=1), (normals[one] * normals[other]).sum(axis=1))
    side = -np.sign(((middles[other] - middles[one]) * normals[one]).sum(axis=1))
    shared = (surface.cells[one][:, :, None] == surface.cells[other][:, None, :]).any(axis=2)
    ends = surface.points[surface.cells[one][shared].reshape(-1, 2)]
    whole = side * angle * np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    bending: FloatArray = np.zeros(surface.n_cells)
    for cells in (one, other):
        np.add.at(bending, cells, 0.5 * whole)
    return bending


def table_of_faces(faces: list[FaceSummary]) -> str:
    """Return the faces as the lines of a table."""
    lines = [f"{'face':12}{'area':>11}{'curvature':>12}  box"]
    for face in faces:
        box = " to ".join(f"({', '.join(f'{x:.4g}' for x in c)})" for c in (face.low, face.high))
        lines.append(f"{face.name:12}{face.area:>11.5g}{face.curvature:>12.4g}  {box}")
    return "\n".join(lines)
