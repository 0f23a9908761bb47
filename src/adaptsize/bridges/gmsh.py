"""Sizes for Gmsh from Python, without a file."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from adaptsize._checks import check_type
from adaptsize._size_function import SizeFunction

if TYPE_CHECKING:
    from adaptsize.domain_size.sparse import SparseSize


def gmsh_callback(
    size: SizeFunction | SparseSize,
) -> Callable[[int, int, float, float, float, float], float]:
    """Return the function that ``gmsh.model.mesh.setSizeCallback`` takes.

    Parameters
    ----------
    size : SizeFunction or SparseSize
        In the plane, the third coordinate is ignored.

    Returns
    -------
    callable
        ``f(dim, tag, x, y, z, lc)``.  Where the size is inf, it returns ``lc``, the size that
        Gmsh would use.

    Raises
    ------
    ValueError
        If ``size`` is not a size function.

    Notes
    -----
    Switch off the sizes that Gmsh adds by itself (``Mesh.MeshSizeFromPoints``,
    ``Mesh.MeshSizeFromCurvature`` and ``Mesh.MeshSizeExtendFromBoundary``).  A call takes about
    60 microseconds, and Gmsh calls it a few times per node of the mesh.  For large meshes write a
    background view instead: ``write("sizes.pos", size)``.

    Examples
    --------
    >>> from adaptsize import SimplexMesh
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    >>> f = gmsh_callback(SizeFunction(mesh, [0.1, 0.2, 0.3]))
    >>> round(f(2, 1, 0.5, 0.0, 0.0, 1e22), 12)
    0.15
    """
    if isinstance(size, SizeFunction):
        dim = size.background.dim
    else:
        from adaptsize.domain_size.sparse import SparseSize  # a room of its own

        check_type("size", size, SizeFunction, SparseSize)
        dim = size.points.shape[1]

    def callback(_dim: int, _tag: int, x: float, y: float, z: float, lc: float) -> float:
        h = float(size([(x, y, z)[:dim]])[0])
        return h if np.isfinite(h) else lc

    return callback
