"""The request to a mesh generator, on a mesh on whose nodes the sizes are known everywhere."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import NamedTuple, cast

import numpy as np

from adaptsize._pickling import once
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.background.bisection import resolved
from adaptsize.limiting.sources import is_equal, is_same
from adaptsize.remeshing import tuning
from adaptsize.remeshing.in_volume import in_volume
from adaptsize.remeshing.preparation import Frame, as_problem
from adaptsize.remeshing.protocol import MeshingProblem, Task
from adaptsize.remeshing.sizing import MetricAt, Size, SizeLike, in_solid, known_points
from adaptsize.remeshing.surface import refine_facets, refine_surface
from adaptsize.typing import FloatArray, IntArray


class RequestedSizes(NamedTuple):
    """Sizes as they were given and as they are used."""

    at: Size
    """The sizes at points."""
    given: SizeLike
    on: SimplexMesh
    """The mesh to which nodal values belong."""
    g: float
    """Gradient that they are likely to have."""
    hmax: float
    metric: MetricAt | None = None
    metric_on: SimplexMesh | None = None
    """The mesh at whose nodes the metric is given; None if it is a function."""

    @property
    def are_nodal(self) -> bool:
        """Whether they are given at the nodes of the mesh, and linear between them."""
        given = self.given
        if isinstance(given, SizeFunction):
            return given.sources is None and given.g is None and is_same(given.background, self.on)
        return not callable(given) and np.ndim(cast(FloatArray, given)) < 2

    def at_nodes(self, mesh: SimplexMesh) -> FloatArray | None:
        """Return the checked sizes of a function at the nodes of a mesh, if they are given there.

        Interpolation would return the same but for rounding, and at slits those of either side.
        """
        given = self.given
        if self.metric is not None or not isinstance(given, SizeFunction) or not self.are_nodal:
            return None
        if not is_equal(mesh.points, self.on.points) or not np.isfinite(given.values).all():
            return None
        return np.minimum(given.values, self.hmax)


def as_request(
    task: Task,
    mesh: SimplexMesh,
    frame: Frame,
    sizes: RequestedSizes,
    tolerance: float,
    required: IntArray | None,
    *,
    is_by_mmg: bool,
) -> MeshingProblem:
    """Return the request to remesh a repaired mesh.

    Generators read sizes at the nodes of a mesh only.  So the cells are divided until the sizes are
    known in them, see `resolved`, unless some facets must not change.

    Parameters
    ----------
    task : str
    mesh : SimplexMesh
    frame : Frame
        The coordinates of the request.
    sizes : RequestedSizes
    tolerance : float
        Over the diagonal.
    required : int32[n, cell_dim] or None
        Facets to keep.
    is_by_mmg : bool
        Only Mmg rounds edges, unless they are passed as ridges.
    """
    # A mesh has one frame.
    own = given = once(mesh, "_in_its_frame", lambda: frame.mesh(mesh))
    ridges = np.empty((0, 2), np.int32)
    size, known = frame.size(sizes.at), frame.to_own(known_points(sizes.given, mesh.dim))
    if task != "surface to tetrahedra" and required is None:
        if is_by_mmg and task != "plane triangles":
            is_plain = task == "surface" and own.is_closed and own.tagged_facets is None
            refined = refine_surface if is_plain else refine_facets
            own, ridges = refined(own, size, tolerance * own.diagonal)
        if sizes.metric is None:
            own, ridges = _resolved(own, ridges, size, sizes, known)
    nodal = sizes.at_nodes(mesh) if own is given else None
    inside = in_solid(sizes.given, sizes.on, sizes.g, sizes.hmax)
    return replace(
        as_problem(task, own, tolerance, required),
        size=size,
        nodal_sizes=None if nodal is None else nodal / frame.scale,
        ridges=ridges,
        size_nodes=known,
        metric=None if sizes.metric is None else frame.metric(sizes.metric),
        metric_mesh=None if sizes.metric_on is None else frame.mesh(sizes.metric_on),
        in_volume=(
            None
            if inside is None
            else partial(in_volume, field=inside[0], frame=frame, limit=inside[1])
        ),
    )


def _resolved(
    mesh: SimplexMesh, ridges: IntArray, size: Size, sizes: RequestedSizes, known: FloatArray
) -> tuple[SimplexMesh, IntArray]:
    """Return a mesh divided until the sizes are known in its cells, and its ridges."""
    if sizes.are_nodal:
        return mesh, ridges
    given = sizes.given
    # Sizes that grow off a surface have this gradient; others are only likely to have it.
    own_g = given.g if isinstance(given, SizeFunction) else None
    fine = resolved(
        mesh,
        size,
        g=sizes.g if own_g is None else own_g,
        is_proved=own_g is not None,
        samples=known,
        factor=tuning.EDGE_OVER_SIZE_FOR_GENERATORS,
        curves=ridges,
        max_points=tuning.MOST_NODES_FOR_GENERATORS,
    )
    return fine.mesh, fine.curves
