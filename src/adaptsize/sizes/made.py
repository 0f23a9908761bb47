"""Number of triangles that Mmg makes of a plane mesh, of which it keeps some cells."""

from __future__ import annotations

import numpy as np

from adaptsize.background import AnyMesh
from adaptsize.background.interpolation import cell_gradients
from adaptsize.background.partitioned import local_mesh
from adaptsize.sizes import tuning
from adaptsize.sizes.budget import ELEMENTS_PER_MEASURE, mean_density
from adaptsize.typing import BoolArray, FloatArray


def triangles_by_mmg(mesh: AnyMesh, h: FloatArray, stays: BoolArray | None = None) -> float:
    r"""Return the number of triangles that Mmg makes of a plane mesh; collective.

    Mmg changes edges only if they are longer than sqrt 2 of their size or shorter than its inverse.
    A cell of which edges of the size h make :math:`n_c` regular triangles is kept with the
    probability :math:`k(n_c)`, which is 1 about n = 1 and 0 far from it.  Where cells are new,
    their number grows with the gradient of the sizes, whose mean there is g:

    .. math:: \sum_c k_c + (a + b g) \sum_c (1 - k_c) \, n_c.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
        Triangles in the plane, from which Mmg starts.
    h : float64[n_points]
        Finite sizes at the nodes.
    stays : bool[n_cells], optional
        Cells that are kept in any case.
    """
    whole, sums = local_mesh(mesh), np.zeros(3)
    if whole is not None:
        wanted = ELEMENTS_PER_MEASURE[2] * whole.measures * mean_density(h[whole.cells])
        edge_over_size = 0.5 * np.log(np.maximum(wanted, 1e-300))
        kept = np.interp(edge_over_size, tuning.KEPT_BY_MMG, (0.0, 1.0, 1.0, 0.0))
        if stays is not None:
            kept[stays] = 1.0
        gradients = np.linalg.norm(cell_gradients(whole, h), axis=1)
        new = (1.0 - kept) * wanted
        sums = np.array([kept.sum(), new.sum(), (new * gradients).sum()])
    n_kept, n_new, by_gradient = mesh.ranks.allreduce(sums, "sum").tolist()
    return float(n_kept + tuning.NEW_BY_MMG * n_new + tuning.NEW_PER_GRADIENT * by_gradient)
