"""What a picture shows, as arrays: the visible faces of a mesh, grid or octree and their values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import one_of
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.background.grid import whole_boxes
from adaptsize.background.topology import compacted, unique_rows
from adaptsize.metrics import Metric
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Direction towards the viewer for surfaces and solids: from the right, the front and above.
_EYE = np.array([0.75, -1.0, 0.8])
_AXES = ("x", "y", "z")
#: Finer grids are drawn with this number of nodes along an axis.  More cannot be distinguished.
_MOST_NODES = {2: 512, 3: 256}


@dataclass(frozen=True)
class Scene:
    """Polygons or segments in space with one value per node or per cell.

    Attributes
    ----------
    points : float64[n, 3]
    cells : int32[m, k]
        Corners of the polygons, or ends of segments.
    values : float64[n] or float64[m]
        Not finite where there is no value to show.
    flat : bool
        Whether the scene is plane and shown from above.
    on_nodes : bool
        Whether ``values`` belong to the points.  All are finite in this case.
    label : str
        Title of the colour bar.
    classes : bool
        Whether values are categories (tags), not quantities.
    class_names : mapping of int to str
        Names of classes.  The others are labelled by number.
    tags : tuple of int
        All classes, also those that are hidden; by default those shown.
    plain : bool
        Whether edges are not drawn.
    color_range : tuple of float, optional
        The values at the ends of the colour bar, by default the lowest and the highest.
    colors : str, optional
        Name of matplotlib's colours, by default those of sizes.
    """

    points: FloatArray
    cells: IntArray
    values: FloatArray
    flat: bool
    on_nodes: bool = True
    label: str = ""
    classes: bool = False
    class_names: Mapping[int, str] = field(default_factory=dict)
    tags: tuple[int, ...] = ()
    plain: bool = False
    color_range: tuple[float, float] | None = None
    colors: str | None = None

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
        """The classes in ascending order: ``tags``, or the distinct values."""
        if self.tags:
            return np.array(self.tags, np.float64)
        return np.unique(self.values[np.isfinite(self.values)])

    @property
    def class_labels(self) -> list[str]:
        """Labels of ``names`` in the picture."""
        return [printable(self.class_names.get(int(name), f"{name:g}")) for name in self.names]

    @property
    def is_logarithmic(self) -> bool:
        """Whether colours follow the logarithm of the values: over more than a factor of ten."""
        low, high = self.limits
        return not self.classes and low > 0.0 and high > 10.0 * low

    @property
    def ticks(self) -> FloatArray:
        """Round numbers between ``limits``, to be written at the colour bar."""
        low, high = self.limits
        if not high > low:
            return np.array([low])
        return _round_numbers(low, high, logarithmic=self.is_logarithmic)

    @property
    def light(self) -> float:
        """How much darker a face is that is seen from its side, 0 to 1.

        Little for quantities: their colours are to be read.
        """
        return 0.0 if self.flat else 0.45 if self.classes or self.plain else 0.2

    @property
    def shows_edges(self) -> bool:
        """Whether edges are to be drawn, and the median one is 1/250 of the picture long."""
        if self.plain:
            return False
        start, stop = self.points[self.cells[:, 0]], self.points[self.cells[:, 1]]
        low, high = self.frame
        median = float(np.median(np.linalg.norm(stop - start, axis=1)))
        return median > float((high - low)[:2].max()) / 250.0


def scene_of_mesh(
    mesh: SimplexMesh, values: npt.NDArray[Any], clip: str | None, *, on_nodes: bool, **look: Any
) -> Scene:
    """Return the visible part of ``mesh`` after the clip; of tetrahedra the outer faces.

    Classes are labelled by the names of cell tags.  The remaining arguments are those of `Scene`.
    """
    extents = np.ptp(mesh.points[np.unique(mesh.cells)], axis=0)
    clip = clip_axis(clip, mesh.dim, extents, solid=mesh.cell_dim == 3)
    cells, values = mesh.cells, np.asarray(values, dtype=np.float64)
    if clip is not None:
        axis = _AXES.index(clip)
        kept = _behind_the_cut(mesh.points[mesh.cells, axis].mean(axis=1), axis)
        cells = cells[kept]
        values = values if on_nodes else values[kept]
    points = np.zeros((mesh.n_points, 3))
    points[:, : mesh.dim] = mesh.points
    if mesh.cell_dim == 3:
        skin = SimplexMesh(mesh.points, cells).boundary()
        cells, points = skin.mesh.cells, skin.mesh.points
        values = values[skin.nodes] if on_nodes else values[skin.cells]
    if look.get("classes") and "class_names" not in look:
        tags = mesh.tag_names.items()
        look["class_names"] = {tag: name for (dim, tag), name in tags if dim == mesh.cell_dim}
    return _finite_scene(Scene(points, cells, values, mesh.dim < 3, on_nodes, **look))


def _finite_scene(scene: Scene) -> Scene:
    """Return a scene in which nodal values that are not finite are left out of the cells."""
    if not scene.on_nodes or np.isfinite(scene.values).all():
        return scene
    corners = scene.values[scene.cells]
    finite = np.isfinite(corners)
    sums, counts = np.where(finite, corners, 0.0).sum(axis=1), finite.sum(axis=1)
    means = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    return replace(scene, values=means, on_nodes=False)


def scene_of_grid(grid: CartesianGrid, values: FloatArray, clip: str | None, **look: Any) -> Scene:
    """Return the visible faces of a grid after the clip: of boxes whose nodes are all active."""
    clip = clip_axis(clip, grid.dim, grid.upper - grid.lower, solid=grid.dim == 3)
    most = _MOST_NODES[grid.dim]  # evenly, the first and the last among them
    shown = [np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int)) for n in grid.shape]
    axes = [axis[i] for axis, i in zip(grid.axes, shown, strict=True)]
    shape = tuple(len(axis) for axis in axes)
    kept = np.ones([n - 1 for n in shape], np.bool_)
    if grid.active is not None:
        kept = whole_boxes(grid.active[np.ix_(*shown)])
    if not kept.any():
        raise ValueError("active must leave at least one box with all its nodes, got none")
    if clip is not None:
        d = _AXES.index(clip)
        # Of the boxes that there are, as the middle of a mesh is that of its cells.
        there = np.flatnonzero(kept.any(axis=tuple(e for e in range(grid.dim) if e != d)))
        middle = 0.5 * (axes[d][1:] + axes[d][:-1])
        stays = np.zeros(len(middle), np.bool_)
        stays[there] = _behind_the_cut(middle[there], d)
        kept &= stays.reshape([-1 if e == d else 1 for e in range(grid.dim)])
    nodes, cells = compacted(_outer_faces(kept, shape))
    indices = np.unravel_index(nodes, shape)
    points = np.zeros((len(nodes), 3))
    for d, i in enumerate(indices):
        points[:, d] = axes[d][i]
    at_nodes = values[tuple(which[i] for which, i in zip(shown, indices, strict=True))]
    return _finite_scene(Scene(points, cells, at_nodes, grid.dim == 2, **look))


def scene_of_octree(tree: Octree, values: FloatArray, clip: str | None, **look: Any) -> Scene:
    """Return the visible faces of the leaves of an octree after the clip."""
    clip = clip_axis(clip, tree.dim, np.subtract(tree.upper, tree.lower), solid=tree.dim == 3)
    around = [0, 2, 3, 1]  # corners are numbered row by row; these go round a square
    corners = tree.leaf_corners
    if clip is not None:
        d = _AXES.index(clip)
        corners = corners[_behind_the_cut(tree.leaf_centres[:, d], d)]
    quads = corners[:, around]
    if tree.dim == 3:
        sides = [
            [corner for corner in range(8) if corner >> (2 - d) & 1 == side]
            for d, side in product(range(3), (0, 1))
        ]
        faces = np.concatenate([corners[:, side][:, around] for side in sides])
        number = unique_rows(faces, tree.n_points)[1]
        quads = faces[np.bincount(number)[number] == 1]
    nodes, cells = compacted(quads)
    points = np.zeros((len(nodes), 3))
    points[:, : tree.dim] = tree.points[nodes]
    return _finite_scene(Scene(points, cells, values[nodes], tree.dim == 2, **look))


def printable(text: str) -> str:
    """Return a text in which characters that have no encoding are replaced."""
    return text.encode(errors="replace").decode()


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


def _behind_the_cut(middles: FloatArray, axis: int) -> npt.NDArray[np.bool_]:
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


def _outer_faces(kept: BoolArray, shape: tuple[int, ...]) -> npt.NDArray[Any]:
    """Return the boxes of a 2-D grid, the outer faces of those of a 3-D one, int64[n, 4]."""
    strides = np.cumprod([1, *shape[:0:-1]])[::-1]
    if len(shape) == 2:
        first = np.argwhere(kept) @ strides
        return _squares(first, strides[0], strides[1])
    faces = []
    for d in range(3):
        across = np.moveaxis(kept, d, 0)
        changes = np.diff(across, axis=0, prepend=False, append=False)
        first = np.argwhere(np.moveaxis(changes, 0, d)) @ strides
        faces.append(_squares(first, *(strides[e] for e in range(3) if e != d)))
    return np.concatenate(faces)


def _squares(first: npt.NDArray[Any], right: int, up: int) -> npt.NDArray[Any]:
    """Return four nodes each, round a square, from the first one and two strides."""
    return np.stack([first, first + right, first + right + up, first + up], axis=1)


#: Corners of an ellipse; rings and columns of an ellipsoid.
_AROUND, _RINGS, _COLUMNS = 40, 8, 14


def scene_of_metric(mesh: SimplexMesh, metric: Metric, n_glyphs: int, clip: str | None) -> Scene:
    """Return glyphs at about evenly distributed nodes, coloured by the smallest size.

    Of tetrahedra, nodes near the plane through the middle are shown.  All glyphs have the same
    length, because sizes usually differ too much to be seen.
    """
    used = np.unique(mesh.cells)
    points = mesh.points[used]
    if mesh.cell_dim == 3:
        extents = np.ptp(points, axis=0)
        axis = "xyz".index(clip_axis(clip, 3, extents, solid=True) or "y")
        spacing = _spacing(np.delete(extents, axis), n_glyphs)
        middle = points[:, axis].min() + 0.5 * extents[axis]
        away = np.abs(points[:, axis] - middle)
        near = away <= max(0.5 * spacing, away.min())  # at least one node
        used, points = used[near], points[near]
    else:
        extents = np.sort(np.ptp(points, axis=0))[::-1]
        spacing = _spacing(extents[:2], n_glyphs)
    chosen = _spread(points, spacing)
    nodes, at = used[chosen], points[chosen]
    sizes = metric.sizes[nodes]
    largest = np.where(np.isfinite(sizes), sizes, 0.0).max(axis=1, keepdims=True)
    largest[largest == 0.0] = 1.0
    # Thinner glyphs could not be seen.  They leave 5 % of the distance between them.
    axes = np.clip(sizes / largest, 0.04, 1.0) * (0.475 * spacing)
    corners, cells = _unit_circle() if mesh.dim == 2 else _unit_sphere()
    placed = at[:, None, :] + np.einsum("nij,nj,kj->nki", metric.directions[nodes], axes, corners)
    full = np.zeros((len(nodes) * len(corners), 3))
    full[:, : mesh.dim] = placed.reshape(-1, mesh.dim)
    shifted = cells + len(corners) * np.arange(len(nodes))[:, None, None]
    faces = shifted.reshape(-1, cells.shape[1]).astype(np.int32)
    values = np.repeat(sizes[:, 0], len(cells))
    return Scene(full, faces, values, mesh.dim == 2, False, "smallest size", plain=True)


def _spacing(extents: FloatArray, n: int) -> float:
    """Return the distance between so many points in a rectangle."""
    return float(np.sqrt(max(extents.prod(), 1e-12 * extents.max() ** 2) / n)) or 1.0


def _spread(points: FloatArray, spacing: float) -> IntArray:
    """Return points that are at least so far from each other, the first one of a row wins."""
    from scipy.spatial import cKDTree

    # Points near the middle of squares first: the result looks like a grid where it can.
    square = np.floor((points - points.min(axis=0)) / spacing)
    off = np.linalg.norm(points - points.min(axis=0) - (square + 0.5) * spacing, axis=1)
    order = np.argsort(off, kind="stable")
    near = cKDTree(points[order]).query_ball_point(points[order], spacing * 0.999)
    taken = np.zeros(len(points), np.bool_)
    for k, others in enumerate(near):
        taken[k] = not taken[others].any()
    return np.asarray(order[taken], np.int32)


def _unit_circle() -> tuple[FloatArray, IntArray]:
    """Return the corners of a disc, and the polygon of them."""
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    return np.column_stack([np.cos(angle), np.sin(angle)]), np.arange(_AROUND, dtype=np.int32)[None]


def _unit_sphere() -> tuple[FloatArray, IntArray]:
    """Return the corners of a sphere and its quadrilaterals, flat ones at the poles."""
    angles = np.pi * np.arange(_RINGS + 1) / _RINGS, 2.0 * np.pi * np.arange(_COLUMNS) / _COLUMNS
    a, b = (x.ravel() for x in np.meshgrid(*angles, indexing="ij"))
    corners = np.column_stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])
    here = np.arange(_RINGS * _COLUMNS)
    right = here - here % _COLUMNS + (here + 1) % _COLUMNS
    return corners, np.column_stack([here, here + _COLUMNS, right + _COLUMNS, right]).astype(
        np.int32
    )
