"""Public functions: pictures of sizes, meshes and causes."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_float_array,
    as_number,
    as_path,
    check_type,
    describe,
    of_type,
    one_of,
)
from adaptsize._formats.guards import write_whole
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import SizeReport
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.background.simplex import as_mesh, as_own
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import PictureOptions, ScaledPictureOptions, checked, with_options
from adaptsize.plot import with_matplotlib, with_vtk
from adaptsize.plot.scene import (
    Scene,
    printable,
    scene_of_grid,
    scene_of_mesh,
    scene_of_metric,
    scene_of_octree,
)
from adaptsize.plot.style import FIELDS, QUALITY, share_of_scene, with_bar
from adaptsize.typing import FloatArray, Unpack


class Picture(np.ndarray):
    """A picture, an array of uint8 that notebooks show."""

    def _repr_png_(self) -> bytes:
        from PIL import Image as Pillow

        file = io.BytesIO()
        Pillow.fromarray(np.asarray(self)).save(file, "png")
        return file.getvalue()


#: Formats of pictures.
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
#: Those without transparency: the background is white.
OPAQUE = (".jpg", ".jpeg", ".bmp")


@with_options(ScaledPictureOptions)
def plot_size(
    mesh: SimplexMesh | CartesianGrid | Octree | SizeFunction,
    size: Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike | None = None,
    *,
    label: str = "mesh size h",
    **options: Unpack[ScaledPictureOptions],
) -> Picture:
    """Draw nodal sizes on a mesh, grid or octree, off-screen.

    Plane meshes are shown from above, surfaces and tetrahedra in an isometric view.
    Colours are logarithmic if the sizes span more than a factor of ten.  Edges are
    drawn if they are long enough to be distinguished.  Infinite sizes are grey.

    Parameters
    ----------
    mesh : SimplexMesh, CartesianGrid, Octree or SizeFunction
        A size function is drawn on its background.  Grids and octrees are drawn as boxes
        and leaves.  Of a grid with ``active``, only boxes with all nodes active are drawn.
    size : array_like of float, of the nodal shape, SizeFunction or callable, optional
        Sizes at the nodes, or a function of points.  By default the nodal field
        ``h`` of a mesh.
    label : str
        Title of the colour bar.
    **options

    Returns
    -------
    Picture
        ndarray of uint8, shape (height, width, 4): red, green, blue, opacity.  Notebooks show it.

    Raises
    ------
    ValueError
        If an argument is bad or ``mesh`` has no field ``h``.

    Notes
    -----
    VTK is used if it finds OpenGL, EGL or OSMesa.  This is tested once in a child
    process, because VTK may crash without them.  Otherwise matplotlib draws the
    triangles from back to front, with one colour each.

    A grid of more than 512 nodes along an axis (256 in 3-D) is drawn with this number of evenly
    chosen nodes.  No tetrahedra are made.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> plot_size(mesh, [0.1, 0.3, 0.5, 0.3], width=320).shape  # doctest: +SKIP
    (249, 320, 4)
    """
    picture = _checked(ScaledPictureOptions, options)
    check_type("label", label, str)
    background: object = mesh
    if isinstance(mesh, SizeFunction):
        background, size = mesh.background, mesh if size is None else size
    return _draw(_scene_of_sizes(background, size, label, picture["clip"]), picture)


@with_options(ScaledPictureOptions)
def plot_mesh(
    mesh: SimplexMesh, *, color: str | None = None, **options: Unpack[ScaledPictureOptions]
) -> Picture:
    """Draw a mesh coloured by the quality or the region of its cells, off-screen.

    Parameters
    ----------
    mesh : SimplexMesh
    color : {"quality", "region"} or str, optional
        By default ``"region"`` for a mesh of several regions, otherwise ``"quality"``.
        ``"quality"`` is the radius ratio (1 equilateral, 0 degenerate), ``"region"`` the
        cell tags, labelled by their names in ``mesh.tag_names``.  Otherwise the
        name of a field of ``mesh`` with one number per node or cell.
    **options

    Returns
    -------
    Picture
        ndarray of uint8, shape (height, width, 4): red, green, blue, opacity.  Notebooks show it.

    Raises
    ------
    ValueError
        If an argument is bad, or the mesh has no such field.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> plot_mesh(mesh, path="square.png")  # doctest: +SKIP
    """
    picture = _checked(ScaledPictureOptions, options)
    mesh = as_mesh("mesh", mesh)
    if color is None:
        has_regions = mesh.cell_tags is not None and np.ptp(mesh.cell_tags) > 0
        color = "region" if has_regions else "quality"
    values, on_nodes = _values_to_show(mesh, color)
    label, classes = "radius ratio" if color == "quality" else printable(color), color == "region"
    colors = QUALITY if color == "quality" else None if color == "h" else FIELDS
    scene = scene_of_mesh(
        mesh, values, picture["clip"],
        on_nodes=on_nodes, label=label, classes=classes, colors=colors,
    )  # fmt: skip
    return _draw(scene, picture)


@with_options(PictureOptions)
def plot_causes(report: SizeReport, **options: Unpack[PictureOptions]) -> Picture:
    """Draw which cause controls the size where, off-screen.

    A cell has the colour of the majority of its nodes.  The exterior of the domain is
    omitted on grids and grey elsewhere.

    Parameters
    ----------
    report : SizeReport
        Of `size_function`.
    **options

    Returns
    -------
    Picture
        ndarray of uint8, shape (height, width, 4): red, green, blue, opacity.  Notebooks show it.

    Raises
    ------
    ValueError
        If an argument is bad.

    Examples
    --------
    >>> size = size_function(part)  # doctest: +SKIP
    >>> plot_causes(size.report, path="causes.png")  # doctest: +SKIP
    """
    check_type("report", report, SizeReport)
    picture = _checked(PictureOptions, options)
    return _draw(scene_of_causes(report, picture["clip"]), picture)


@with_options(ScaledPictureOptions)
def plot_metric(
    mesh: SimplexMesh | MetricFunction,
    metric: Metric | None = None,
    *,
    n_glyphs: int = 400,
    **options: Unpack[ScaledPictureOptions],
) -> Picture:
    """Draw a metric as ellipses (in space: ellipsoids), off-screen.

    The axes of a glyph are proportional to the sizes at its node.  All glyphs are scaled to the
    same length, and thin ones are drawn with at least 1/25 of it.  The colour is the smallest size.

    Parameters
    ----------
    mesh : SimplexMesh or MetricFunction
    metric : Metric, optional
        At the nodes of the mesh; not with a MetricFunction.
    n_glyphs : int
        About this number of glyphs, at nodes that are about evenly distributed.  Of tetrahedra,
        the nodes near the plane of the cut are shown.
    **options

    Returns
    -------
    Picture
        ndarray of uint8, shape (height, width, 4): red, green, blue, opacity.  Notebooks show it.

    Raises
    ------
    ValueError
        If an argument is bad.

    Examples
    --------
    >>> plot_metric(mesh, metric, path="metric.png")  # doctest: +SKIP
    """
    if isinstance(mesh, MetricFunction):
        if metric is not None:
            raise ValueError("metric must be None with a MetricFunction, got both")
        metric, mesh = mesh.metric, mesh.mesh
    mesh = as_mesh("mesh", mesh)
    metric = of_type("metric", metric, Metric)
    metric.check_mesh(mesh)
    if mesh.dim == 1:
        raise ValueError(f"mesh must be in 2-D or 3-D, got {mesh!r}")
    picture = _checked(ScaledPictureOptions, options)
    number = as_number("n_glyphs", n_glyphs, lower=1.0)
    return _draw(scene_of_metric(mesh, metric, int(number), picture["clip"]), picture)


def plot(shown: SimplexMesh | SizeFunction, **options: Any) -> Picture:
    """Show this mesh or size function in a window, or as a picture where no window can open.

    See `SizeFunction.plot`.
    """
    window = options.get("path") is None and with_vtk.opens_windows()
    given = {"window": window} | options
    if isinstance(shown, SimplexMesh):
        return plot_mesh(shown, **given)
    return plot_size(shown, **given)


def _values_to_show(mesh: SimplexMesh, color: str) -> tuple[npt.NDArray[Any], bool]:
    one_of("color", color, ("quality", "region", *mesh.point_data, *mesh.cell_data))
    if color == "quality":
        from adaptsize.quality.elements import radius_ratios

        return radius_ratios(mesh), False
    if color == "region":
        if mesh.cell_tags is None:
            return np.zeros(mesh.n_cells), False
        return mesh.cell_tags, False
    on_nodes = color in mesh.point_data
    values = np.asarray(mesh.point_data[color] if on_nodes else mesh.cell_data[color])
    if values.ndim != 1:
        raise ValueError(f"color must name a field of numbers, got {color!r} {values.shape}")
    return values, on_nodes


def _checked(record: type, options: Any) -> dict[str, Any]:
    """Return the checked options of a picture."""
    given: dict[str, Any] = checked(record, options)
    path, limits = given["path"], given.get("limits")
    if path is not None and as_path("path", path).suffix.lower() not in SUFFIXES:
        raise ValueError(f"path must end in {', '.join(SUFFIXES)}, got {os.fspath(path)!r}")
    if limits is not None:
        low, high = as_float_array("limits", limits, (2,)).tolist()
        if not (np.isfinite([low, high]).all() and low < high):
            raise ValueError(
                f"limits must be finite and in ascending order, got {describe(limits)}"
            )
        given["limits"] = low, high
    return given


def _scene_of_sizes(
    background: object,
    size: Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike | None,
    label: str,
    clip: str | None,
) -> Scene:
    background = as_own(background)
    if isinstance(background, CartesianGrid) and background.dim == 1:
        background = background.mesh
    if not isinstance(background, SimplexMesh | CartesianGrid | Octree):
        raise ValueError(
            f"mesh must be a mesh, grid or octree, or live on one, got {describe(background)}"
        )
    if size is None:
        size = _field_h(background)
    if callable(size):
        size = (
            background.sample(size)
            if isinstance(background, CartesianGrid)
            else size(background.points)
        )
    values = as_float_array("size", size, background.nodal_shape)
    if isinstance(background, CartesianGrid):
        return scene_of_grid(background, values, clip, label=printable(label))
    if isinstance(background, Octree):
        return scene_of_octree(background, values, clip, label=printable(label))
    return scene_of_mesh(background, values, clip, on_nodes=True, label=printable(label))


def scene_of_causes(report: SizeReport, clip: str | None) -> Scene:
    """Return a scene in which a cell has the cause of the majority of its nodes."""
    background = report.background
    if isinstance(background, CartesianGrid):
        background = background.with_active(report.cause >= 0)
    scene = _scene_of_sizes(background, report.cause.astype(np.float64), "cause", clip)
    counts = np.stack([(scene.values[scene.cells] == k).sum(axis=1) for k in report.codes])
    return replace(
        scene,
        values=np.where(counts.max(axis=0) > 0, counts.argmax(axis=0), np.nan),
        on_nodes=False,
        classes=True,
        class_names=dict(enumerate(report.causes)),
        plain=True,
    )


def _field_h(background: SimplexMesh | CartesianGrid | Octree) -> npt.NDArray[Any]:
    if not isinstance(background, SimplexMesh):
        raise ValueError("size must be given: grids and octrees carry no fields")
    if "h" not in background.point_data:
        fields = ", ".join(background.point_data) or "none"
        raise ValueError(f"size must be given: the mesh has no nodal field 'h' ({fields})")
    return background.point_data["h"]


def _draw(scene: Scene, picture: dict[str, Any]) -> Picture:
    width, path = picture["width"], picture["path"]
    if not scene.classes:
        scene = replace(scene, color_range=picture["limits"])
    if picture["window"]:
        if not with_vtk.opens_windows():
            raise ValueError("window must be False in notebooks and without a display, got True")
        image = with_vtk.show(scene)
    else:
        low, high = scene.frame
        across, up = np.maximum((high - low)[:2], 1e-12 * max(np.abs(high - low).max(), 1e-300))
        inner = round(width * share_of_scene(scene, width))
        height = int(np.clip(inner * up / across, 0.25 * width, 0.9 * width))
        backend = with_vtk if with_vtk.is_possible() else with_matplotlib
        image = with_bar(backend.draw(scene, inner, height), scene, width)
    if path is not None:
        from PIL import Image as Pillow

        file = Pillow.fromarray(image)
        if Path(path).suffix.lower() in OPAQUE:
            white = Pillow.new("RGBA", file.size, "white")
            file = Pillow.alpha_composite(white, file).convert("RGB")
        write_whole(Path(path), file.save)
    return image.view(Picture)
