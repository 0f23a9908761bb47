"""Sizes and metrics in the form that generators need: callables, or a background mesh."""

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_number, describe, refuse_where
from adaptsize._messages import Message
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.bisection import resolved
from adaptsize.limiting.inside import SolidField
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.remeshing import tuning
from adaptsize.typing import FloatArray, IntArray

#: What ``remesh`` takes as ``size``.
SizeLike: TypeAlias = SizeFunction | Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike
Size: TypeAlias = Callable[[FloatArray], FloatArray]


def as_size(
    size: SizeLike, mesh: SimplexMesh, *, g: float | None = None, hmax: float = np.inf
) -> Size:
    """Return the size as a function of points that checks its values.

    Parameters
    ----------
    size : SizeFunction, callable, array_like of float with one value per node, or float
    mesh : SimplexMesh
        Mesh of the nodal values.
    g : float, optional
        Gradient with which sizes grow off a surface or a line, unless they have their own.
    hmax : float
        Upper limit of the sizes; not checked.

    Raises
    ------
    ValueError
        If a size is not finite and positive, or the shape is wrong.  The returned
        function raises it too.
    """
    if isinstance(size, SizeFunction):
        size = _grown(_beyond_active(size), g, hmax)
    if callable(size):
        return _checked(size, hmax)
    values = as_float_array("size", size)
    if values.ndim == 0:
        number = min(as_number("size", values, lower=0.0, strict=True), hmax)
        return lambda points: np.full(len(points), number)
    values = as_float_array("size", size, mesh.nodal_shape)
    _refuse_bad(values)
    return _checked(_grown(SizeFunction(mesh, values), g, hmax), hmax)


def in_solid(
    size: SizeLike, mesh: SimplexMesh, g: float | None, hmax: float
) -> tuple[SolidField, float] | None:
    """Return sizes that grow inside the solid of a surface, and the largest one.

    None if they are given otherwise.
    """
    if not isinstance(size, SizeFunction):
        if callable(size) or np.ndim(size) == 0:
            return None
        size = SizeFunction(mesh, as_float_array("size", size))
    size = _grown(size, g, hmax)
    field = size._field
    return (field, min(hmax, size.hmax)) if isinstance(field, SolidField) else None


def _grown(size: SizeFunction, g: float | None, hmax: float) -> SizeFunction:
    """Return sizes that grow off a surface in space, if they are defined on one."""
    background = size.background
    on_surface = isinstance(background, SimplexMesh) and background.cell_dim < background.dim
    if not on_surface or g is None or size.g is not None:
        return size
    return SizeFunction(background, size.values, g=g, hmax=hmax)


def known_points(size: SizeLike, dim: int) -> FloatArray:
    """Return the nodes of the background of the size function, if it has one, and its sources.

    Most nodes of a grid are not needed.  Of a grid, only nodes with a size smaller than that of
    their neighbours along an axis are returned, because a coarser sampling would miss them.
    """
    background = getattr(size, "background", None)
    if isinstance(size, SizeFunction) and isinstance(background, CartesianGrid):
        return _valleys(background, size.values) if background.dim == dim else np.empty((0, dim))
    points = getattr(background, "points", None)
    if points is None or np.shape(points)[1] != dim:
        return np.empty((0, dim))
    inner = getattr(size, "inner", None)
    if inner is not None:
        points = np.concatenate([points, *(source.samples for source in inner.sources)])
    return np.asarray(points)


def _valleys(grid: CartesianGrid, values: FloatArray) -> FloatArray:
    """Return the active nodes that are a minimum along some axis, float64[n, dim]."""
    valley = np.zeros(grid.shape, np.bool_)
    for d in range(grid.dim):
        h, low = np.moveaxis(values, d, 0), np.moveaxis(valley, d, 0)
        least = np.minimum(h[2:], h[:-2]) >= h[1:-1]
        low[1:-1] |= least & (np.maximum(h[2:], h[:-2]) > h[1:-1])
    if grid.active is not None:
        valley &= grid.active
    return grid.origin + grid.spacing * np.argwhere(valley)


def sample_in_box(
    size: Size, mesh: SimplexMesh, known: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return a background of tetrahedra over the box around ``mesh``, with sizes.

    The box is larger than the mesh, so that the size is defined also where the new surface
    lies slightly outside the old one.  Its cells are divided until the sizes are known in them.

    Parameters
    ----------
    size : callable
    mesh : SimplexMesh
    known : float64[n, 3]
        More points where the sizes are needed.

    Returns
    -------
    points : float64[n, 3]
    cells : int32[m, 4]
    sizes : float64[n]
    """
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    margin = tuning.MARGIN * mesh.diagonal
    shape = 2 + ((high - low + 2.0 * margin) / (tuning.SPACING * mesh.diagonal)).astype(int)
    spacing = (high - low + 2.0 * margin) / (shape - 1)
    box = CartesianGrid(low - margin, spacing, tuple(shape.tolist())).mesh
    samples = np.concatenate([mesh.points, known])
    fine = resolved(box, size, samples=samples, max_points=tuning.MOST_SAMPLES).mesh
    return fine.points, fine.cells, size(fine.points)


def _beyond_active(size: SizeFunction) -> SizeFunction:
    """Give inactive nodes of a grid the size of the nearest active node.

    Generators also evaluate sizes outside the part, where the grid has none.
    """
    grid = size.background
    if not isinstance(grid, CartesianGrid) or grid.active is None:
        return size
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(
        ~grid.active, sampling=grid.spacing, return_distances=False, return_indices=True
    )
    full = grid.with_active(None)
    return SizeFunction(full, size.values[tuple(nearest)], outside=size.outside)


def _checked(function: Callable[[FloatArray], Any], hmax: float) -> Size:
    def size(points: FloatArray) -> FloatArray:
        values = as_float_array("size(points)", function(points), (len(points),))
        _refuse_bad(values)
        return np.minimum(values, hmax)

    return size


def _refuse_bad(values: FloatArray) -> None:
    refuse_where(
        "size", ~(np.isfinite(values) & (values > 0.0)), values, "must be finite and positive"
    )


def once_per_point(size: Size) -> Size:
    """Return the same size, evaluated only where it has not been before.

    Most points are asked for again while edges are divided.  An evaluation costs ten times as much
    as a look into the table.
    """
    known: dict[bytes, float] = {}

    def remembered(points: FloatArray) -> FloatArray:
        keys = [point.tobytes() for point in points]
        new = [i for i, key in enumerate(keys) if key not in known]
        if new:
            known.update(zip([keys[i] for i in new], size(points[new]).tolist(), strict=True))
        return np.array([known[key] for key in keys])

    return remembered


#: A checked metric as a function of points.
MetricAt: TypeAlias = Callable[[FloatArray], Metric]


def as_metric_at(size: Any, mesh: SimplexMesh, hmax: float) -> MetricAt | None:
    """Return a requested metric as a function of points that checks it, or None for sizes.

    Parameters
    ----------
    size : Metric, MetricFunction, or callable that returns a Metric; anything else is a size
    mesh : SimplexMesh
        Mesh of the nodal values.
    hmax : float
        Upper limit of the sizes.

    Raises
    ------
    ValueError
        If the metric does not belong to the mesh or has infinite sizes.  The returned function
        raises it too.
    """
    if isinstance(size, Metric):
        size = MetricFunction(mesh, size)
    elif (
        isinstance(size, SizeFunction)
        or not callable(size)
        or not isinstance(size(mesh.points[:1]), Metric)
    ):
        return None

    def checked(there: Metric, points: FloatArray) -> Metric:
        if not isinstance(there, Metric) or there.sizes.shape != points.shape:
            wanted = f"a Metric with {len(points)} nodes in {points.shape[1]}-D"
            raise ValueError(f"size(points) must be {wanted}, got {describe(there)}")
        if np.isfinite(hmax):
            there = there.clip(hmax=hmax)
        bad = np.isinf(there.sizes)
        wanted = Message("must be finite in all directions: pass {hmax}")
        refuse_where("size", bad, there.sizes, wanted)
        return there

    is_nodal = isinstance(size, MetricFunction) and np.array_equal(size.mesh.points, mesh.points)
    at_nodes = size.metric if is_nodal and mesh.in_a_cell.all() else size(mesh.points)
    checked(at_nodes, mesh.points)
    return lambda points: checked(size(points), points)


def mean_size(metric: MetricAt, cell_dim: int) -> Size:
    """Return the mean of the sizes as a function of points, see `mean_of`."""
    return lambda points: mean_of(metric(points), cell_dim)


def mean_of(metric: Metric, cell_dim: int) -> FloatArray:
    """Return the geometric mean of the sizes: that of regular cells of the same measure.

    On a surface it is the mean of the two smallest, because the largest is that along the normal.
    """
    return np.asarray(np.exp(np.log(metric.sizes[:, :cell_dim]).mean(axis=1)))


def metric_on(size: Any, mesh: SimplexMesh) -> SimplexMesh | None:
    """Return the mesh at whose nodes a metric is given, if its cells are like those of ``mesh``."""
    on = mesh if isinstance(size, Metric) else getattr(size, "mesh", None)
    if not isinstance(size, Metric | MetricFunction) or on is None:
        return None
    return on if on.cell_dim == mesh.cell_dim else None
