"""Meshes of triangles, tetrahedra and line segments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from math import factorial
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_nodes, check_type
from adaptsize._defaults import CREASE_ANGLE
from adaptsize._kernels.simplex import fill_measures
from adaptsize._kernels.topology import mark_nodes
from adaptsize._pickling import ReadOnlyState
from adaptsize.background import _mesh_arrays as arrays
from adaptsize.background import topology
from adaptsize.background.enclosing import enclosing_diameter
from adaptsize.background.location import SimplexLocator
from adaptsize.ranks import Communicator, SharedNodes, no_shared_nodes
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray, Unpack

if TYPE_CHECKING:
    from adaptsize.distributed import DolfinxMesh
    from adaptsize.metrics.metric import Metric
    from adaptsize.options import ScaledPictureOptions
    from adaptsize.plot.pictures import Picture
    from adaptsize.quality.summary import MeshSummary
    from adaptsize.remeshing.surface_checks import NearBodies, OpenBoundary, OverlappingBodies

_Result = TypeVar("_Result")
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
class SimplexMesh(ReadOnlyState):
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
        # Several times faster than along an axis.
        return float(np.linalg.norm([np.ptp(x[self.in_a_cell]) for x in self.points.T]))

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
        mark_nodes(self.cells, used)
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
        fill_measures(self.points, self.cells, measures)
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
        i, j = self.edges.T
        return arrays.read_only(np.linalg.norm(self.points[i] - self.points[j], axis=1))

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

    @classmethod
    def from_object(
        cls, mesh: Any, *, kind: str | None = None, flatten: bool = True
    ) -> SimplexMesh:
        """Return the simplices of a mesh of another program, with its tags and their names.

        Functions that take a mesh to remesh, limit, write or draw call this themselves.

        Parameters
        ----------
        mesh : object
            A mesh of meshio, PyVista (or a data set of VTK), trimesh (or a scene), scikit-fem,
            DOLFINx (also with its tags, as ``model_to_mesh`` returns it), MFEM, Netgen or NGSolve,
            or ``gmsh.model``, the current model of Gmsh.  Not changed.
        kind, flatten
            Which cells to read, and whether a coordinate z = 0 is dropped, as for `read`.

        Returns
        -------
        SimplexMesh
            Subdomains, materials, attributes, physical groups and parts of scenes are cell tags,
            those of boundaries are tagged facets, with their names.

        Raises
        ------
        ValueError
            If the object is none of these, or has no such cells.

        Examples
        --------
        >>> import trimesh
        >>> SimplexMesh.from_object(trimesh.creation.box())
        SimplexMesh(8 points in 3-D, 12 triangles)
        """
        from adaptsize.bridges.meshes import from_object

        return from_object(mesh, kind=kind, flatten=flatten)

    def to_meshio(self, *, tag_name: str = "cell_tags") -> Any:
        """Return a ``meshio.Mesh`` with the same cells, tags, tagged facets, names and fields.

        Parameters
        ----------
        tag_name : str, default "cell_tags"
            Name of the cell data for the tags.  Use ``"gmsh:physical"`` for files of Gmsh.
            meshio writes these with groups as ``file_format="gmsh22"``; in version 4.1 of the
            format it omits them.  Cells without a tag then form a separate group, as for
            `write`.

        Returns
        -------
        meshio.Mesh
            Tagged facets form a second block of cells.  Other cell data are NaN there, or 0
            for integers.  Names of tags are in ``field_data``, like those of Gmsh's groups.

        Raises
        ------
        ValueError
            If two tags have the same name, or a field is not numeric.
        """
        from adaptsize.bridges.meshes import to_meshio

        return to_meshio(self, tag_name=tag_name)

    def to_pyvista(self) -> Any:
        """Return a ``pyvista.UnstructuredGrid`` with the same cells, tags, names and fields.

        Returns
        -------
        pyvista.UnstructuredGrid
            Tags are the cell data ``"cell_tags"``.  Tagged facets are additional cells, on which
            other cell data are NaN, or 0 for integers.  Names of tags are strings in the field
            data ``"tag_names"``.  Points of plane meshes get z = 0.
        """
        from adaptsize.bridges.meshes import to_pyvista

        return to_pyvista(self)

    def to_trimesh(self) -> Any:
        """Return a ``trimesh.Trimesh`` of triangles in space, or of the boundary of tetrahedra.

        Points and triangles are in the same order.  Tags are left out.
        """
        from adaptsize.bridges.meshes import to_trimesh

        return to_trimesh(self)

    def to_dolfinx(self) -> DolfinxMesh:
        """Return a ``dolfinx.mesh.Mesh`` on this process, with its tags and nodal fields.

        ``mesh.topology.original_cell_index`` and ``mesh.geometry.input_global_indices`` of the
        result are the numbers of the cells and points here.  For many processes see
        `adaptsize.distributed.to_dolfinx`.

        Returns
        -------
        adaptsize.distributed.DolfinxMesh
            ``(mesh, cell_tags, facet_tags, physical_groups, functions)``.
        """
        from adaptsize.bridges.solvers import to_dolfinx

        return to_dolfinx(self)

    def to_gmsh(self, name: str = "adaptsize") -> Any:
        """Make the mesh a new model of Gmsh, with tags as physical groups; return ``gmsh.model``.

        Parameters
        ----------
        name : str
            Of the model.  Gmsh is initialized if it is not yet.

        Raises
        ------
        ValueError
            If a tag is negative, or 0 on a facet.
        """
        from adaptsize.bridges.solvers import to_gmsh

        return to_gmsh(self, name)

    def to_mfem(self) -> Any:
        """Return an ``mfem.ser.Mesh``, tags as attributes and their names as sets of attributes.

        Without tagged facets, the boundary has the attribute 1.

        Raises
        ------
        ValueError
            If a tag is negative, or 0 on a facet.
        """
        from adaptsize.bridges.solvers import to_mfem

        return to_mfem(self)

    def to_netgen(self) -> Any:
        """Return a ``netgen.meshing.Mesh``; ``ngsolve.Mesh`` of it is that of NGSolve.

        Tags are materials and boundaries, called by their names or their numbers.  Cells and points
        keep their order.  Without tagged facets, the boundary is one region.

        Raises
        ------
        ValueError
            If the mesh does not fill the plane or the space, a tag is negative, or 0 on a facet.
        """
        from adaptsize.bridges.solvers import to_netgen

        return to_netgen(self)

    def to_skfem(self) -> Any:
        """Return a mesh of scikit-fem with named subdomains and boundaries.

        Returns
        -------
        skfem.MeshLine, MeshTri or MeshTet
            Tags without a name in ``tag_names`` are called by their number.

        Raises
        ------
        ValueError
            If the cells do not have the dimension of the points.
        """
        from adaptsize.bridges.solvers import to_skfem

        return to_skfem(self)

    def plot(self, *, color: str | None = None, **options: Unpack[ScaledPictureOptions]) -> Picture:
        """Show this mesh in a window, or as a picture where no window can open.

        A window opens where there is a display, unless a ``path`` is given.  Notebooks show
        pictures.

        Parameters
        ----------
        color, **options
            As for `plot_mesh`.  ``window=False`` only draws, as that does; so does the environment
            variable ``PYVISTA_OFF_SCREEN=true``.

        Returns
        -------
        Picture
            ndarray of uint8, shape (height, width, 4): red, green, blue, opacity.

        Raises
        ------
        ValueError
            If an argument is bad.

        Examples
        --------
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
        >>> mesh.plot(color="quality")  # doctest: +SKIP
        """
        from adaptsize.plot.pictures import plot

        return plot(self, color=color, **options)

    def summarize(self) -> MeshSummary:
        """Return counts, extent, tags, fields, topology and quality of a mesh.

        Returns
        -------
        MeshSummary

        Notes
        -----
        The cost is O(n log n).  Points are duplicates if all their coordinates are equal.

        Examples
        --------
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
        >>> summary = mesh.summarize()
        >>> summary.n_boundary_facets, summary.measure, summary.angle_min
        (4, 1.0, 45.0)
        """
        from adaptsize.quality.summary import summarize

        return summarize(self)

    def radius_ratios(self) -> FloatArray:
        r"""Return the radius ratio of each cell, float64[n_cells], 0 to 1.

        It is the radius r of the inscribed sphere over the radius R of the circumscribed sphere,
        scaled to 1 for the regular simplex [1]_: ``2 r / R`` for triangles, ``3 r / R`` for
        tetrahedra.  Degenerate cells have 0.  The orientation does not matter.

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
        >>> SimplexMesh([[0, 0], [1, 0], [0.5, 0.75**0.5]], [[0, 1, 2]]).radius_ratios().round(12)
        array([1.])
        """
        from adaptsize.quality.elements import radius_ratios

        return radius_ratios(self)

    def minimum_angles(self) -> FloatArray:
        """Return the smallest angle of each triangle, or dihedral angle of each tetrahedron.

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
        >>> SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]).minimum_angles().round(12)
        array([45.])
        """
        from adaptsize.quality.elements import minimum_angles

        return minimum_angles(self)

    def metric_qualities(self, metric: Metric) -> FloatArray:
        r"""Return how regular each cell is in a metric: 1 regular, 0 flat.

        With the linear map J from a regular simplex to the cell and the metric M in the cell, the
        result is the mean ratio [1]_

        .. math:: q = k \, \det(J^T M J)^{1/k} / \mathrm{tr}(J^T M J)

        for cells of dimension k.  M is the log-Euclidean mean of the metrics of the corners.

        Parameters
        ----------
        metric : Metric
            At its nodes, with finite sizes.

        Returns
        -------
        ndarray of float64, shape (n_cells,)

        References
        ----------
        .. [1] A. Liu, B. Joe, "Relationship between tetrahedron shape measures", BIT 34 (1994)
           268-287.

        Examples
        --------
        A triangle that is regular after a stretching by 10:

        >>> from adaptsize import Metric
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [0.5, 5 * np.sqrt(3)]], [[0, 1, 2]])
        >>> stretched = Metric([[1.0, 10.0]] * 3, [np.eye(2)] * 3)
        >>> mesh.metric_qualities(stretched).round(12)
        array([1.])
        >>> mesh.metric_qualities(Metric.isotropic([1.0, 1.0, 1.0], 2)).round(3)
        array([0.198])
        """
        from adaptsize.quality.elements import metric_qualities

        return metric_qualities(self, metric)

    def sizes(self) -> FloatArray:
        """Return the mean length of the edges at each node: the size that the mesh has there.

        Returns
        -------
        ndarray of float64, shape (n_points,)
            inf at nodes in no cell.  ``SizeFunction(mesh, mesh.sizes())`` is the size function that
            the mesh follows, for instance to remesh another mesh like it, or for a `time_step`.

        Examples
        --------
        >>> SimplexMesh([[0, 0], [1, 0], [0, 2]], [[0, 1, 2]]).sizes().round(3)
        array([1.5  , 1.618, 2.118])
        """
        total, count = (
            np.bincount(self.edges.ravel(), np.repeat(of_edge, 2), self.n_points)
            for of_edge in (self.edge_lengths, np.ones(len(self.edges)))
        )
        h = np.full(self.n_points, np.inf)
        np.divide(total, count, out=h, where=count > 0.0)
        return h

    def implied_metric(self) -> Metric:
        """Return for each cell the metric in which all its edges have the length 1.

        Let J be the linear map from a regular simplex of edge 1 to the cell.  Then
        :math:`M = (J J^T)^{-1}`.  The sizes are the singular values of J, and their ratio is the
        aspect ratio of the cell.

        Returns
        -------
        Metric
            One per cell.

        Raises
        ------
        ValueError
            If the cells do not have the dimension of the space, or one is flat.

        Examples
        --------
        A regular triangle, stretched by 10 along y:

        >>> import numpy as np
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [0.5, 5 * np.sqrt(3)]], [[0, 1, 2]])
        >>> metric = mesh.implied_metric()
        >>> metric.sizes.round(12), metric.aspect_ratio.round(12)
        (array([[ 1., 10.]]), array([10.]))
        """
        from adaptsize.metrics.implied import implied_metric

        return implied_metric(self)

    def crease_edges(self, *, crease_angle: float = CREASE_ANGLE) -> IntArray:
        """Return the feature edges of a surface: boundary, non-manifold, sharp and tagged edges.

        The cells are triangles in space, in any orientation.

        Sharp edges with a loose end, a node on no other feature edge, are none; see `Faces`.

        Parameters
        ----------
        crease_angle : float, default 40
            Edges with a larger angle between the two normals are sharp; in degrees.

        Returns
        -------
        ndarray of int32, shape (n_creases, 2)
            Node indices, ``i < j``, in lexicographic order.

        Raises
        ------
        ValueError
            If the cells are not triangles in space, or the angle is out of range.

        Examples
        --------
        >>> points = [[0, 0, 1], [1, 0, 1], [0, 1, 0], [0, -1, 0]]
        >>> roof = SimplexMesh(points, [[0, 1, 2], [0, 1, 3]])
        >>> roof.crease_edges().tolist()
        [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3]]
        >>> roof.crease_edges(crease_angle=91.0).tolist()
        [[0, 2], [0, 3], [1, 2], [1, 3]]
        """
        from adaptsize.geometry.creases import crease_edges

        return crease_edges(self, crease_angle=crease_angle)

    def tag_faces(self, angle: float = 40.0) -> SimplexMesh:
        """Return a surface with a tag for each face; faces are separated by feature edges.

        The cells are triangles in space, in any orientation.

        A file such as STL contains triangles but no faces.  The tags are kept by `remesh`.  They
        can be used to prescribe sizes with `RegionSource`, and boundary conditions in a solver.

        Parameters
        ----------
        angle : float, default 40
            Edges with a larger angle between the normals of their two triangles are feature edges;
            so are edges of one, three or more triangles, and tagged edges.  In degrees, from 0 to
            180.

        Returns
        -------
        SimplexMesh
            The same mesh with ``cell_tags`` 1 to n instead of the given ones.  Triangles have the
            same tag if they are connected by a path that crosses no feature edge.  Faces are
            numbered in the order of their first triangles.

        Raises
        ------
        ValueError
            If the cells are not triangles in space, or the angle is out of range.

        Notes
        -----
        Time and memory are O(n).  A feature edge that ends inside a face does not divide it.

        Examples
        --------
        The six triangles at a corner of a cube, two on each of its sides:

        >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
        >>> cells = [[0, 1, 2], [0, 2, 3], [0, 1, 5], [0, 5, 4], [0, 3, 6], [0, 6, 4]]
        >>> SimplexMesh(points, cells).tag_faces().cell_tags
        array([1, 1, 2, 2, 3, 3], dtype=int32)
        """
        from adaptsize.geometry.creases import tag_faces

        return tag_faces(self, angle)

    def open_boundary(self, within: float = 0.0) -> OpenBoundary | None:
        """Return the open edges of a surface in space, or None if it is closed.

        The cells are triangles in space.  Coincident points count as one.

        Parameters
        ----------
        within : float
            Loops narrower than this are not counted: gaps that a generator with this tolerance
            closes.  The width is the area over half the length.

        Examples
        --------
        >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        >>> print(SimplexMesh(points, [[0, 1, 3], [1, 2, 3], [2, 0, 3]]).open_boundary())
        3 open edges in 1 loop with an area of 0.5, 3.414 long around (0.3333, 0.3333, 0)
        """
        from adaptsize.remeshing.surface_checks import open_boundary

        return open_boundary(self, within)

    def near_bodies(
        self, within: float, *, overlapping: OverlappingBodies | None = None
    ) -> NearBodies | None:
        """Return the components of a surface that are closer than a distance, or None.

        The cells are triangles in space.  Coincident points count as one.

        Parameters
        ----------
        within : float
            Distance in the unit of the coordinates.
        overlapping : OverlappingBodies or None
            Pairs to leave out, from `overlapping_bodies` of the same surface.

        Warns
        -----
        OpenSurfaceWarning
            If there are more than 2000 components.  Their distances are not examined then.

        Notes
        -----
        The distance is measured at the nodes, the midpoints of the edges and the centroids, so
        components that cross each other between these points may be missed: see
        `overlapping_bodies`.

        Examples
        --------
        >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.01], [1, 0, 0.01], [0, 1, 0.01]]
        >>> print(SimplexMesh(points, [[0, 1, 2], [3, 4, 5]]).near_bodies(0.1))
        1 pair of bodies is only 0.01 apart at (0, 0, 0)
        """
        from adaptsize.remeshing.surface_checks import near_bodies

        return near_bodies(self, within, overlapping=overlapping)

    def overlapping_bodies(self) -> OverlappingBodies | None:
        """Return the components of a surface that overlap or intersect themselves, or None.

        The cells are triangles in space.  Coincident points count as one.

        Notes
        -----
        Bodies that touch do not overlap, whether in points, edges or whole facets, nor do bodies of
        which one is inside the other.  Penetrations up to 1e-6 of the diagonal count as contacts.

        Every pair of triangles whose boxes meet is tested.  Bodies without such a pair may overlap
        where their facets are in common planes.  Hence up to 2000 points of each are tested for
        being inside the other, for at most 200 pairs of bodies.

        Examples
        --------
        >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [2, 0.2, 0]]
        >>> print(SimplexMesh(points, [[0, 1, 2], [3, 4, 5]]).overlapping_bodies())
        bodies 1 and 2 overlap: 2 triangles cross others, by up to 0.2 at (0.5, 0.2, 0)
        """
        from adaptsize.remeshing.surface_checks import overlapping_bodies

        return overlapping_bodies(self)

    def close_holes(self) -> SimplexMesh:
        """Return a surface whose holes are closed by triangles between the nodes of their edges.

        The cells are triangles in space.

        Returns
        -------
        SimplexMesh
            Coincident points are merged, and degenerate triangles dropped.  New triangles have the
            tag 0 if the surface has ``cell_tags``.  Nodal fields are kept, cell fields are not.

        Raises
        ------
        ValueError
            If the surface encloses no volume even then, like a sheet, or if the open edges do not
            form loops.

        Notes
        -----
        Each loop of open edges gets the triangulation of least area [1]_; for a plane hole that is
        its interior.  A hole in a strongly curved region is closed by nearly plane triangles, which
        does not restore the shape.  The rim of a part that is open by design, such as a pipe, is a
        hole too.

        References
        ----------
        .. [1] G. Barequet, M. Sharir, "Filling gaps in the boundary of a polyhedron", Computer
           Aided Geometric Design 12 (1995) 207-229.

        Examples
        --------
        A cube without its top:

        >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        >>> quads = [[0, 2, 6, 4], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]]
        >>> cells = [c for a, b, c, d in quads for c in ([a, b, c], [a, c, d])]
        >>> closed = SimplexMesh(points, cells).close_holes()
        >>> closed.is_closed, closed.n_cells
        (True, 12)
        """
        from adaptsize.remeshing.hole_filling import close_holes

        return close_holes(self)

    def _repr_html_(self) -> str:
        """Return a table and, of up to a million cells, a picture where this machine can draw."""
        from adaptsize.plot.notebook import html_of

        return html_of(self)

    def with_data(
        self,
        *,
        point_data: Mapping[str, npt.ArrayLike] | None = None,
        cell_data: Mapping[str, npt.ArrayLike] | None = None,
    ) -> SimplexMesh:
        """Return the same mesh with fields added or replaced; topology is shared."""
        new = replace(
            self,
            point_data={**self.point_data, **arrays.as_mapping("point_data", point_data)},
            cell_data={**self.cell_data, **arrays.as_mapping("cell_data", cell_data)},
        )
        for name, value in self.__dict__.items():  # values of cached properties
            new.__dict__.setdefault(name, value)
        return new

    def without_data(self) -> SimplexMesh:
        """Return the same mesh without fields; topology is shared."""
        new = replace(self, point_data={}, cell_data={})
        for name, value in self.__dict__.items():  # values of cached properties
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


def _signed_measures(corners: FloatArray) -> FloatArray:
    """Return the measures of cells of full dimension, negative if they are inverted."""
    edges = corners[:, 1:] - corners[:, :1]
    return np.asarray(np.linalg.det(edges) / factorial(edges.shape[1]))
