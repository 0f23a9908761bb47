"""Quality of single elements: radius ratios and angles."""

from collections.abc import Callable
from itertools import combinations
from typing import TypeAlias

import numpy as np

from adaptsize._checks import check_type
from adaptsize.background import AnyMesh, SimplexMesh
from adaptsize.typing import FloatArray

# Cells are processed in blocks whose numbers fit into the cache.
_CELLS_AT_ONCE = 4096


def radius_ratios(mesh: SimplexMesh) -> FloatArray:
    r"""Return the radius ratio of each cell, float64[n_cells], 0 to 1.

    It is the radius r of the inscribed sphere over the radius R of the circumscribed sphere,
    scaled to 1 for the regular simplex [1]_: ``2 r / R`` for triangles, ``3 r / R`` for
    tetrahedra.  Degenerate cells have 0.  The orientation does not matter.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles, in the plane or in space, or tetrahedra.

    Raises
    ------
    ValueError
        If the mesh consists of segments.

    Notes
    -----
    With the edge vectors e1, e2, e3 from one corner, lengths a, b, c, area A and volume V,

    .. math::

        \frac{2r}{R} = \frac{16 A^2}{abc\,(a+b+c)}, \qquad
        \frac{3r}{R} = \frac{108 V^2}
        {\sum_f A_f\; \big| |e_1|^2 e_2 \times e_3 + |e_2|^2 e_3 \times e_1
        + |e_3|^2 e_1 \times e_2 \big|}.

    References
    ----------
    .. [1] A. Liu, B. Joe, "Relationship between tetrahedron shape measures", BIT 34
       (1994) 268-287.

    Examples
    --------
    >>> radius_ratios(SimplexMesh([[0, 0], [1, 0], [0.5, 0.75**0.5]], [[0, 1, 2]])).round(12)
    array([1.])
    """
    ratios = _of_cells(mesh, _radius_ratios_of_triangles, _radius_ratios_of_tetrahedra)
    # Rounding may lift a regular cell above 1.
    return np.asarray(np.minimum(ratios, 1.0))


def minimum_angles(mesh: SimplexMesh) -> FloatArray:
    """Return the smallest angle of each triangle, or dihedral angle of each tetrahedron.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles, in the plane or in space, or tetrahedra.

    Returns
    -------
    ndarray of float64, shape (n_cells,)
        Degrees: at most 60 for triangles, at most 70.53 (arccos 1/3) for tetrahedra, and 0 for
        degenerate cells.  The orientation does not matter.

    Raises
    ------
    ValueError
        If the mesh consists of segments.

    Notes
    -----
    Let e be an edge between two faces whose other edges from the same corner are u and v.  The
    tangent of the dihedral angle at e is ``6 V |e| / ((e x u) . (e x v))``.  The arctangent is
    accurate for all angles.  The arccosine of the normals would lose half the digits
    near 0 and 180 degrees.

    Examples
    --------
    >>> minimum_angles(SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])).round(12)
    array([45.])
    """
    return np.asarray(np.degrees(_of_cells(mesh, _angles_of_triangles, _angles_of_tetrahedra)))


def check_cells(mesh: AnyMesh) -> None:
    """Raise a ValueError if a mesh consists of segments."""
    if mesh.cell_dim == 1:
        raise ValueError(f"mesh must consist of triangles or tetrahedra, got {mesh!r}")


_Formula: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]


def _of_cells(mesh: SimplexMesh, of_triangles: _Formula, of_tetrahedra: _Formula) -> FloatArray:
    """Return a formula of corners, float64[k + 1, dim, m], and measures; 0 for degenerate cells.

    Each cell is scaled by its longest extent, so that products of lengths stay in the
    range of float64.
    """
    check_type("mesh", mesh, SimplexMesh)
    check_cells(mesh)
    formula, values = of_triangles if mesh.cell_dim == 2 else of_tetrahedra, np.zeros(mesh.n_cells)
    for first in range(0, mesh.n_cells, _CELLS_AT_ONCE):
        part = slice(first, first + _CELLS_AT_ONCE)
        # Each coordinate of a corner is a contiguous row.
        corners = np.ascontiguousarray(mesh.points[mesh.cells[part]].transpose(1, 2, 0))
        corners = corners - corners[0]
        extent = np.abs(corners).max(axis=(0, 1))
        extent[extent == 0.0] = 1.0
        corners /= extent
        measures = mesh.measures[part] / extent**mesh.cell_dim
        with np.errstate(invalid="ignore"):  # 0 / 0
            values[part] = np.where(measures > 0.0, formula(corners, measures), 0.0)
    return values


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray((a * b).sum(axis=0))


def _lengths(vectors: FloatArray) -> FloatArray:
    return np.sqrt(_dot(vectors, vectors))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.stack([a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)])


def _radius_ratios_of_triangles(corners: FloatArray, areas: FloatArray) -> FloatArray:
    a, b, c = (_lengths(corners[i] - corners[j]) for i, j in ((1, 2), (2, 0), (0, 1)))
    return np.asarray(16.0 * areas**2 / (a * b * c * (a + b + c)))


def _radius_ratios_of_tetrahedra(corners: FloatArray, volumes: FloatArray) -> FloatArray:
    e1, e2, e3 = (corners[i] - corners[0] for i in (1, 2, 3))
    n1, n2, n3 = _cross(e2, e3), _cross(e3, e1), _cross(e1, e2)
    opposite = _cross(corners[2] - corners[1], corners[3] - corners[1])
    area = 0.5 * (_lengths(n1) + _lengths(n2) + _lengths(n3) + _lengths(opposite))
    centre = _lengths(_dot(e1, e1) * n1 + _dot(e2, e2) * n2 + _dot(e3, e3) * n3)  # 12 V R
    return np.asarray(108.0 * volumes**2 / (area * centre))


def _angles_of_triangles(corners: FloatArray, areas: FloatArray) -> FloatArray:
    angles = []
    for i in range(3):
        u, v = (corners[(i + k) % 3] - corners[i] for k in (1, 2))
        angles.append(np.arctan2(2.0 * areas, _dot(u, v)))
    return np.asarray(np.min(angles, axis=0))


def _angles_of_tetrahedra(corners: FloatArray, volumes: FloatArray) -> FloatArray:
    angles = []
    for i, j in combinations(range(4), 2):
        k, m = (v for v in range(4) if v not in (i, j))
        e, u, v = (corners[other] - corners[i] for other in (j, k, m))
        cosine = _dot(_cross(e, u), _cross(e, v))
        angles.append(np.arctan2(6.0 * volumes * _lengths(e), cosine))
    return np.asarray(np.min(angles, axis=0))
