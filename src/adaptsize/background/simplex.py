"""Meshes of triangles, tetrahedra and line segments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import as_nodes, check_type
from adaptsize._kernels.simplex import fill_measures
from adaptsize._kernels.topology import mark_nodes
from adaptsize._pickling import ReadOnlyState
from adaptsize._workers import in_all_threads
from adaptsize.background import _mesh_arrays as arrays
from adaptsize.background import topology
from adaptsize.background._curve import along_curve
from adaptsize.background.enclosing import enclosing_diameter
from adaptsize.background.location import SimplexLocator
from adaptsize.background.methods.exchange import ExchangeMethods
from adaptsize.background.methods.pictures import PictureMethods
from adaptsize.background.methods.quality import QualityMethods
from adaptsize.background.methods.surfaces import SurfaceMethods
from adaptsize.ranks import Communicator, SharedNodes, no_shared_nodes
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

_Result = TypeVar("_Result")
# Cells per chunk of a thread that measures them, some milliseconds.
_CELLS_TO_MEASURE = 1 << 14
# What is kept with a mesh and follows from cells and tags alone, see `once`.
_WITHOUT_PLACES = ("in_a_cell", "_facets_that_stay", "_repeated_cells")
# Height of a triangle over the length of a side, up to which it is flat.
_FLAT = 1e-14
_CELL_NAMES = {1: "segments", 2: "triangles", 3: "tetrahedra"}


class Boundary(NamedTuple):
    """The boundary of a mesh.

    Parameters
    ----------
    mesh : SimplexMesh
        The boundary facets as a separate mesh, normals outward.
    nodes : IntArray
        ``nodes[i]`` is the node of the whole mesh at boundary node i.
    cells : IntArray
        ``cells[f]`` is the cell of the whole mesh that owns boundary facet f.
    """

    mesh: SimplexMesh
    nodes: IntArray
    cells: IntArray


#: Packages whose meshes `SimplexMesh.from_object` takes.
_OTHER_PROGRAMS = (
    *("dolfinx", "gmsh", "meshio", "mfem", "netgen"),
    *("ngsolve", "pyvista", "skfem", "trimesh", "vtkmodules"),
)


def as_own(value: _Result) -> _Result:
    """Return the mesh of another program as a SimplexMesh, and anything else as it is."""
    owner = value if isinstance(value, type | ModuleType) else type(value)  # gmsh.model is a class
    name = getattr(owner, "__module__", owner.__name__)
    is_foreign = name.partition(".")[0] in _OTHER_PROGRAMS
    return cast(_Result, SimplexMesh.from_object(value)) if is_foreign else value


def as_mesh(name: str, value: _Result, *others: type) -> _Result:
    """Return a mesh, also of another program, or an object of other classes; refuse the rest."""
    own = as_own(value)
    check_type(name, own, SimplexMesh, *others)
    return own


def cut_out(points: FloatArray, cells: IntArray, **tags: Any) -> tuple[SimplexMesh, IntArray]:
    """Return a mesh of the nodes of some cells, and the number of each of them in ``points``."""
    nodes, local = topology.compacted(cells)
    return SimplexMesh(points[nodes], local, **tags), nodes


@dataclass(init=False, frozen=True, eq=False, repr=False)
class SimplexMesh(ExchangeMethods, QualityMethods, SurfaceMethods, PictureMethods, ReadOnlyState):
    """Simplices of one kind: triangles (in the plane or in space), tetrahedra or segments.

    Cells may have any orientation, may be degenerate, and need not form a manifold.  Nodes
    may belong to no cell.  Arrays that the caller could still modify are copied; all arrays
    are read-only afterwards.  Topology is computed on first use and cached.

    Parameters
    ----------
    points : array_like of float, shape (n_points, dim)
        Coordinates, the largest from 1e-60 to 1e60 in size (or 0); ``dim`` is 1 to 3.
    cells : array_like of int, shape (n_cells, k + 1)
        Point indices of the simplices of dimension ``k <= dim``.  There must be at least one
        cell.
    cell_tags : array_like of int, shape (n_cells,), optional
        Region of each cell.
    tagged_facets : array_like of int, shape (n_tagged, k), optional
        Facets (edges of triangles, triangles of tetrahedra) that carry a tag, for example
        for boundary conditions, interfaces or feature edges.
    facet_tags : array_like of int, shape (n_tagged,), optional
        Tags of these facets.
    tag_names : mapping of (int, int) to str, optional
        Names of tags by dimension and tag.  On a mesh of tetrahedra,
        ``{(3, 1): "fluid", (2, 7): "inlet"}`` names the cell tag 1 and the facet tag 7.
        These are the physical groups of Gmsh.
    point_data : mapping of str to array_like, optional
        Fields with one row per node.
    cell_data : mapping of str to array_like, optional
        Fields with one row per cell.

    Raises
    ------
    ValueError
        If a shape is wrong, a coordinate or an index is out of range, a cell contains a node
        twice, there is no cell, or a tag is not a 32-bit integer.

    Examples
    --------
    The unit square as two triangles:

    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> mesh
    SimplexMesh(4 points in 2-D, 2 triangles)
    >>> mesh.measures
    array([0.5, 0.5])
    >>> mesh.edges.tolist()
    [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]
    """

    points: FloatArray
    cells: IntArray
    _: KW_ONLY
    cell_tags: IntArray | None = None
    tagged_facets: IntArray | None = None
    facet_tags: IntArray | None = None
    tag_names: Mapping[tuple[int, int], str] = field(default_factory=dict)
    point_data: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)
    cell_data: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)
    original: SimplexMesh | None = field(default=None, init=False)
    """The first mesh of the adaptive loop that has made this one, in space; see `adapt`."""

    def __init__(
        self,
        points: npt.ArrayLike,
        cells: npt.ArrayLike,
        *,
        cell_tags: npt.ArrayLike | None = None,
        tagged_facets: npt.ArrayLike | None = None,
        facet_tags: npt.ArrayLike | None = None,
        tag_names: Mapping[tuple[int, int], str] | None = None,
        point_data: Mapping[str, npt.ArrayLike] | None = None,
        cell_data: Mapping[str, npt.ArrayLike] | None = None,
    ) -> None:
        own_points = arrays.own(as_nodes("points", points), points)
        own_cells = arrays.own(arrays.as_cells(cells, own_points), cells)
        n_points, (n_cells, width) = len(own_points), own_cells.shape
        facets, tags = arrays.as_tagged_facets(tagged_facets, facet_tags, n_points, width - 1)
        checked = {
            "points": own_points,
            "cells": own_cells,
            "cell_tags": arrays.as_tags("cell_tags", cell_tags, n_cells),
            "tagged_facets": facets,
            "facet_tags": tags,
            "tag_names": arrays.as_tag_names(tag_names),
            "point_data": arrays.as_fields("point_data", point_data, n_points),
            "cell_data": arrays.as_fields("cell_data", cell_data, n_cells),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)  # needed for a frozen dataclass

    def __repr__(self) -> str:
        """Return the numbers of points and cells and the kind of cells."""
        kind = _CELL_NAMES[self.cell_dim]
        return f"SimplexMesh({self.n_points} points in {self.dim}-D, {self.n_cells} {kind})"

    @property
    def _mesh(self) -> SimplexMesh:
        return self

    @property
    def n_points(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cells)

    @property
    def dim(self) -> int:
        """Number of coordinates of a point, 1 to 3."""
        return int(self.points.shape[1])

    @property
    def cell_dim(self) -> int:
        """Dimension of the cells: 1 for segments, 2 for triangles, 3 for tetrahedra."""
        return int(self.cells.shape[1]) - 1

    @property
    def nodal_shape(self) -> tuple[int, ...]:
        """Shape of an array of nodal values, ``(n_points,)``."""
        return (self.n_points,)

    @cached_property
    def diagonal(self) -> float:
        """Length of the diagonal of the bounding box of the nodes that belong to a cell."""
        points = self.points if self.in_a_cell.all() else self.points[self.in_a_cell]
        lower, upper = arrays.bounding_box(points)
        return float(np.linalg.norm(upper - lower))

    @cached_property
    def diameter(self) -> float:
        """Diameter of the smallest ball around the nodes that belong to a cell.

        It does not depend on the orientation of the mesh, as the diagonal does.
        """
        return enclosing_diameter(self.points[self.in_a_cell])

    @cached_property
    def in_a_cell(self) -> BoolArray:
        """Which nodes belong to a cell, bool[n_points]."""
        used = np.zeros(self.n_points, bool)

        def mark(first: int, last: int) -> None:
            mark_nodes(self.cells[first:last], used)  # all threads write the same value

        in_all_threads(mark, self.n_cells, arrays.CELLS)
        return arrays.read_only(used)

    @property
    def ranks(self) -> Communicator:
        """A single rank: the mesh is whole.  A `distributed.PartitionedMesh` has several."""
        return self.shared.ranks

    @cached_property
    def shared(self) -> SharedNodes:
        """The nodes that other ranks hold too: none."""
        return no_shared_nodes()

    @cached_property
    def measures(self) -> FloatArray:
        """Length, area or volume of each cell, float64[n_cells], >= 0."""
        measures = np.empty(self.n_cells)

        def fill(first: int, last: int) -> None:
            if self.cell_dim == self.dim == 2:
                measures[first:last] = _areas(self.points[self.cells[first:last]])
            else:
                fill_measures(self.points, self.cells[first:last], measures[first:last])

        in_all_threads(fill, self.n_cells, _CELLS_TO_MEASURE)
        return arrays.read_only(measures)

    @cached_property
    def signed_measures(self) -> FloatArray:
        """Measure of each cell, negative if the cell is inverted; needs ``cell_dim == dim``."""
        if self.cell_dim != self.dim:
            raise ValueError(f"signed_measures needs cells of full dimension, got {self!r}")
        return arrays.read_only(_signed_measures(self.points[self.cells]))

    @cached_property
    def _topology(self) -> topology.CellTopology:
        return topology.CellTopology(self.cells, self.n_points)

    @property
    def edges(self) -> IntArray:
        """Unique edges, int32[n_edges, 2], ``i < j``, in lexicographic order."""
        return self._topology.edges

    @cached_property
    def edge_lengths(self) -> FloatArray:
        """Length of each edge in ``edges``, float64[n_edges]."""
        return arrays.read_only(arrays.lengths(self.points, self.edges))

    @property
    def facets(self) -> IntArray:
        """Unique facets, int32[n_facets, cell_dim], sorted indices, in lexicographic order."""
        return self._topology.facets[0]

    @property
    def cell_facets(self) -> IntArray:
        """``cell_facets[c, v]`` is the facet of cell c opposite to its vertex v."""
        return self._topology.facets[1]

    @property
    def facet_cell_counts(self) -> IntArray:
        """Number of cells at each facet: 1 on the boundary, 2 inside, 3 or more non-manifold."""
        return self._topology.facet_cell_counts

    @property
    def rings(self) -> tuple[IntArray, IntArray]:
        """Cells around each node as compressed rows ``(ring_ptr, ring)``, cells ascending."""
        return self._topology.rings

    @cached_property
    def locator(self) -> SimplexLocator:
        """Search tree for the cell that contains, or is closest to, each point.

        See `SimplexLocator.nearest`.
        """
        return SimplexLocator(self)

    @cached_property
    def _along_curve(self) -> IntArray:
        """The nodes in the order of a Morton curve, int32[n_points]."""
        return arrays.read_only(along_curve(self.points))

    @property
    def is_closed(self) -> bool:
        """Whether every facet belongs to more than one cell, as for a watertight surface."""
        return not bool((self.facet_cell_counts == 1).any())

    def boundary(self) -> Boundary:
        """Return the facets that belong to one cell only, as a mesh with indices into this one.

        Returns
        -------
        Boundary
            ``mesh`` has the same ``dim``.  Normals point outward; in 2-D the domain lies to
            the left of the segments.  If ``cell_dim < dim``, the orientation is that of the
            owning cell.  ``nodes`` are the nodes in this mesh, and ``cells`` the owning cells.
            Tags of ``tagged_facets`` on the boundary become the ``cell_tags`` of ``mesh``, 0
            for facets without a tag, and keep their names.

        Raises
        ------
        ValueError
            If the mesh is closed or consists of segments.
        """
        if self.cell_dim == 1:
            raise ValueError("the boundary of segments is not a mesh; cells must have 3 or 4 nodes")
        on_boundary = self.facet_cell_counts == 1
        if not on_boundary.any():
            raise ValueError("the mesh is closed: it has no boundary")
        cell, _, facets, tags = facets_with_normals(self, on_boundary)
        nodes, local = topology.compacted(facets)
        mesh = SimplexMesh(
            self.points[nodes],
            local,
            cell_tags=tags,
            tag_names=self.tag_names,
            point_data={name: values[nodes] for name, values in self.point_data.items()},
        )
        return Boundary(mesh, nodes, cell.astype(np.int32))

    def with_data(
        self,
        *,
        point_data: Mapping[str, npt.ArrayLike] | None = None,
        cell_data: Mapping[str, npt.ArrayLike] | None = None,
    ) -> SimplexMesh:
        """Return the same mesh with fields added or replaced; topology is shared."""
        return self._with_fields(
            {**self.point_data, **arrays.as_mapping("point_data", point_data)},
            {**self.cell_data, **arrays.as_mapping("cell_data", cell_data)},
        )

    @recorded("SimplexMesh.without_data")
    def without_data(self) -> SimplexMesh:
        """Return the same mesh without fields; topology is shared."""
        return self._with_fields({}, {})

    def with_original(self, original: SimplexMesh | None) -> SimplexMesh:
        """Return the same mesh with another first mesh of its loop; topology is shared."""
        new = self._with_fields(self.point_data, self.cell_data)
        object.__setattr__(new, "original", original)  # needed for a frozen dataclass
        return new

    def _with_fields(
        self, point_data: Mapping[str, Any], cell_data: Mapping[str, Any]
    ) -> SimplexMesh:
        """Return the same mesh with these fields and no others."""
        new = replace(self, point_data=point_data, cell_data=cell_data)
        # Values of cached properties, to which another thread may add.
        for name, value in list(self.__dict__.items()):
            new.__dict__.setdefault(name, value)
        return new

    def moved(self, points: npt.ArrayLike) -> SimplexMesh:
        """Return the mesh with its nodes at other points, without fields; topology is shared.

        Parameters
        ----------
        points : array_like of float, shape (n_points, dim)

        Returns
        -------
        SimplexMesh
            With the same cells and tags.

        Examples
        --------
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
        >>> float(mesh.moved(2.0 * mesh.points).measures[0])
        2.0
        """
        new = replace(self, points=as_nodes("points", points), point_data={}, cell_data={})
        if new.points.shape != self.points.shape:
            raise ValueError(f"points must have shape {self.points.shape}, got {new.points.shape}")
        new.__dict__["_topology"] = self._topology
        for name in _WITHOUT_PLACES:
            if name in self.__dict__:
                new.__dict__[name] = self.__dict__[name]
        return new


def facets_with_normals(
    mesh: SimplexMesh, chosen: BoolArray
) -> tuple[IndexArray, IndexArray, IntArray, IntArray | None]:
    """Return the cells at chosen facets, and the facets with normals out of these cells.

    Returns
    -------
    cell, opposite : intp[n]
        The cells, and their vertices that are not in the facet.
    facets : int32[n, cell_dim]
    tags : int32[n] or None
        0 for facets without a tag; None if there are no tags.
    """
    cell, opposite = np.nonzero(chosen[mesh.cell_facets])
    inverted = tags = None
    if mesh.cell_dim == mesh.dim:
        inverted = _signed_measures(mesh.points[mesh.cells[cell]]) < 0.0
    facets = topology.oriented_facets(mesh.cells[cell], opposite, inverted)
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        every = topology.tags_of_facets(
            mesh.facets, mesh.tagged_facets, mesh.facet_tags, mesh.n_points
        )
        tags = every[mesh.cell_facets[cell, opposite]]
    return cell, opposite, facets, tags


def _areas(corners: FloatArray) -> FloatArray:
    """Return the areas of triangles in the plane, 0 of flat ones, as `fill_measures` does.

    The kernel, for cells of any dimension, takes five times as long.
    """
    a, b = (corners[:, v] - corners[:, 0] for v in (1, 2))
    (ax, ay), (bx, by) = a.T, b.T
    twice = np.abs(ax * by - ay * bx)
    squares = (ax * ax + ay * ay) * (bx * bx + by * by)
    return np.where(twice > _FLAT * np.sqrt(squares), 0.5 * twice, 0.0)


def _signed_measures(corners: FloatArray) -> FloatArray:
    """Return the measures of cells of full dimension, negative if they are inverted."""
    # By hand: a factorization of each small matrix takes ten times as long.
    edges = [corners[:, v] - corners[:, 0] for v in range(1, corners.shape[1])]
    rows = [edge.T for edge in edges]
    if len(rows) == 1:
        return np.asarray(rows[0][0])
    if len(rows) == 2:
        (a, b), (c, d) = rows
        return np.asarray(0.5 * (a * d - b * c))
    (a, b, c), (d, e, f), (g, h, i) = rows
    return np.asarray((a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)) / 6.0)
