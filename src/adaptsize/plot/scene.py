"""The content of a picture as arrays: triangles, their values, and the view direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import one_of
from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray, IntArray

#: Direction towards the viewer for surfaces and solids: from the right, the front and above.
_EYE = np.array([0.75, -1.0, 0.8])
#: Colours of regions, chosen for colour-blind readers (Okabe and Ito 2008).
CLASS_COLORS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#F0E442", "#0072B2", "#D55E00")
_AXES = ("x", "y", "z")
#: Edges are drawn where the median edge is longer than this share of the picture's width.
_SHORTEST_DRAWN_EDGE = 1.0 / 250.0
#: A range of sizes wider than this is coloured by logarithm.
_LINEAR_RANGE = 10.0


@dataclass(frozen=True)
class Scene:
    """Triangles, quadrilaterals or segments in space with one value per node or per cell.

    Attributes
    ----------
    points : float64[n, 3]
    cells : int32[m, 3], int32[m, 4] or int32[m, 2]
    values : float64[n] or float64[m]
        Not finite where there is no value to show.
    on_nodes : bool
        Whether ``values`` belong to the points.  All are finite in this case.
    label : str
        Title of the colour bar.
    classes : bool
        Whether values are categories (tags), not quantities.
    flat : bool
        Whether the scene is plane and shown from above.
    class_names : mapping of int to str
        Names of classes.  The others are labelled by number.
    plain : bool
        Whether edges are not drawn.
    color_range : tuple of float, optional
        The values at the ends of the colour bar, by default the lowest and the highest.
    """

    points: FloatArray
    cells: IntArray
    values: FloatArray
    on_nodes: bool
    label: str
    classes: bool
    flat: bool
    class_names: Mapping[int, str] = field(default_factory=dict)
    plain: bool = False
    color_range: tuple[float, float] | None = None

    @property
    def axes(self) -> FloatArray:
        """Orthonormal rows: directions to the right, up and towards the viewer."""
        if self.flat:
            return np.eye(3)
        eye = _EYE / np.linalg.norm(_EYE)
        right = np.cross((0.0, 0.0, 1.0), eye)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(eye, right), eye])

    @property
    def frame(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinates along ``axes`` of what is shown."""
        seen = self.points[np.unique(self.cells)] @ self.axes.T
        return seen.min(axis=0), seen.max(axis=0)

    @property
    def limits(self) -> tuple[float, float]:
        """Ends of the colour bar: the lowest and highest finite value; 0 and 1 without any."""
        if self.color_range is not None:
            return self.color_range
        shown = self.values[np.isfinite(self.values)]
        return (float(shown.min()), float(shown.max())) if len(shown) else (0.0, 1.0)

    @property
    def names(self) -> FloatArray:
        """The distinct values in ascending order: the classes."""
        return np.unique(self.values[np.isfinite(self.values)])

    @property
    def class_labels(self) -> list[str]:
        """Labels of ``names`` in the picture."""
        names = [self.class_names.get(int(name), f"{name:g}") for name in self.names]
        return [_printable(name) for name in names]

    @property
    def is_logarithmic(self) -> bool:
        """Whether colours follow the logarithm of the values."""
        low, high = self.limits
        return not self.classes and low > 0.0 and high > _LINEAR_RANGE * low

    @property
    def ticks(self) -> FloatArray:
        """Round numbers between ``limits``, to be written at the colour bar."""
        low, high = self.limits
        if not high > low:
            return np.array([low])
        return _round_numbers(low, high, logarithmic=self.is_logarithmic)

    @property
    def is_shaded(self) -> bool:
        """Whether cells are lit: not those with quantities, whose colours could not be read."""
        return not self.flat and (self.classes or self.plain)

    @property
    def shows_edges(self) -> bool:
        """Whether edges are to be drawn, and long enough in the picture."""
        if self.plain:
            return False
        start, stop = self.points[self.cells[:, 0]], self.points[self.cells[:, 1]]
        low, high = self.frame
        median = float(np.median(np.linalg.norm(stop - start, axis=1)))
        return median > _SHORTEST_DRAWN_EDGE * float((high - low)[:2].max())

    @property
    def values_of_cells(self) -> FloatArray:
        """One value per cell: the mean of its nodes where values are on nodes."""
        return self.values[self.cells].mean(axis=1) if self.on_nodes else self.values


def make_scene(
    mesh: SimplexMesh,
    values: npt.NDArray[Any],
    *,
    label: str,
    clip: str | None,
    on_nodes: bool,
    classes: bool = False,
) -> Scene:
    """Return the visible part of ``mesh`` after the clip; of tetrahedra the outer faces.

    Classes are labelled by the names of cell tags.
    """
    extents = np.ptp(mesh.points[np.unique(mesh.cells)], axis=0)
    clip = clip_axis(clip, mesh.dim, extents, solid=mesh.cell_dim == 3)
    cells, values = mesh.cells, np.asarray(values, dtype=np.float64)
    if clip is not None:
        axis = _AXES.index(clip)
        kept = behind_the_cut(mesh.points[mesh.cells, axis].mean(axis=1), axis)
        cells = cells[kept]
        values = values if on_nodes else values[kept]
    points = np.zeros((mesh.n_points, 3))
    points[:, : mesh.dim] = mesh.points
    if mesh.cell_dim == 3:
        skin = SimplexMesh(mesh.points, cells).boundary()
        cells, points = skin.mesh.cells, skin.mesh.points
        values = values[skin.nodes] if on_nodes else values[skin.cells]
    scene = scene_of_cells(
        points,
        cells,
        values,
        label=label,
        on_nodes=on_nodes,
        classes=classes,
        flat=mesh.dim < 3,
    )
    names = {tag: name for (dim, tag), name in mesh.tag_names.items() if dim == mesh.cell_dim}
    return replace(scene, class_names=names) if classes else scene


def scene_of_cells(
    points: FloatArray,
    cells: IntArray,
    values: FloatArray,
    *,
    label: str,
    flat: bool,
    on_nodes: bool = True,
    classes: bool = False,
) -> Scene:
    """Return a scene in which nodal values that are not finite are left out of the cells."""
    if on_nodes and not np.isfinite(values).all():
        values, on_nodes = _means_of_finite(values[cells]), False
    return Scene(points, cells, values, on_nodes, _printable(label), classes, flat)


def _printable(text: str) -> str:
    """Return a text in which characters that have no encoding are replaced."""
    return text.encode(errors="replace").decode()


def _means_of_finite(corners: FloatArray) -> FloatArray:
    """Return the mean of the finite values of each row; NaN where a row has none."""
    finite = np.isfinite(corners)
    sums, counts = np.where(finite, corners, 0.0).sum(axis=1), finite.sum(axis=1)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def clip_axis(clip: str | None, dim: int, extents: FloatArray, *, solid: bool) -> str | None:
    """Return the axis normal to the cut for these extents, or None without a cut."""
    if clip is None:
        return None
    one_of("clip", clip, ("auto", *_AXES[:dim]))
    if clip != "auto":
        return clip
    if not solid:
        return None
    # Not along the longest side, to show a long section.  Of equal sides, prefer y to z.
    return _AXES[int(np.argsort(extents * (1.0, 1.0 + 1e-6, 1.0 - 1e-6))[1])]


def behind_the_cut(middles: FloatArray, axis: int) -> npt.NDArray[np.bool_]:
    """Mark the whole cells that remain when the half towards the viewer is removed."""
    cut = 0.5 * (middles.min() + middles.max())
    kept: npt.NDArray[np.bool_] = (middles - cut) * _EYE[axis] <= 0.0
    return kept


def _round_numbers(low: float, high: float, *, logarithmic: bool) -> FloatArray:
    """Return at most seven numbers of few digits from low to high, at least two of them."""
    if logarithmic:
        decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
        every = 1 + len(decades) // 7
        choices = [np.outer(decades, (1.0, 2.0, 5.0)).ravel(), decades, decades[::every]]
        shown = [_between(choice, low, high) for choice in choices]
        return next((ticks for ticks in shown if len(ticks) <= 7), shown[-1])
    coarse = 10.0 ** np.ceil(np.log10(high - low))
    for step in coarse * np.array([0.5, 0.25, 0.2, 0.1, 0.05, 0.025, 0.02]):
        ticks = _between(step * np.arange(np.ceil(low / step), high / step + 1.0), low, high)
        if len(ticks) >= 4:
            break
    return ticks


def _between(numbers: FloatArray, low: float, high: float) -> FloatArray:
    """Return the numbers from low to high, with a tolerance for rounding."""
    slack = 1e-12 * np.abs(numbers)
    return numbers[(numbers >= low - slack) & (numbers <= high + slack)]
