"""Methods of surfaces in space."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adaptsize._calls import recorded
from adaptsize._defaults import CREASE_ANGLE
from adaptsize.background.methods.group import MeshMethods
from adaptsize.typing import IntArray

if TYPE_CHECKING:
    from adaptsize.background.simplex import SimplexMesh
    from adaptsize.remeshing.surface_checks import NearBodies, OpenBoundary, OverlappingBodies


class SurfaceMethods(MeshMethods):
    """Feature edges, faces, and defects of surfaces of triangles in space."""

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
        >>> from adaptsize import SimplexMesh
        >>> points = [[0, 0, 1], [1, 0, 1], [0, 1, 0], [0, -1, 0]]
        >>> roof = SimplexMesh(points, [[0, 1, 2], [0, 1, 3]])
        >>> roof.crease_edges().tolist()
        [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3]]
        >>> roof.crease_edges(crease_angle=91.0).tolist()
        [[0, 2], [0, 3], [1, 2], [1, 3]]
        """
        from adaptsize.geometry.creases import crease_edges

        return crease_edges(self._mesh, crease_angle=crease_angle)

    @recorded("SimplexMesh.tag_faces")
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

        >>> from adaptsize import SimplexMesh
        >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
        >>> cells = [[0, 1, 2], [0, 2, 3], [0, 1, 5], [0, 5, 4], [0, 3, 6], [0, 6, 4]]
        >>> SimplexMesh(points, cells).tag_faces().cell_tags
        array([1, 1, 2, 2, 3, 3], dtype=int32)
        """
        from adaptsize.geometry.creases import tag_faces

        return tag_faces(self._mesh, angle)

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
        >>> from adaptsize import SimplexMesh
        >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        >>> print(SimplexMesh(points, [[0, 1, 3], [1, 2, 3], [2, 0, 3]]).open_boundary())
        3 open edges in 1 loop with an area of 0.5, 3.414 long around (0.3333, 0.3333, 0)
        """
        from adaptsize.remeshing.surface_checks import open_boundary

        return open_boundary(self._mesh, within)

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
        >>> from adaptsize import SimplexMesh
        >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.01], [1, 0, 0.01], [0, 1, 0.01]]
        >>> print(SimplexMesh(points, [[0, 1, 2], [3, 4, 5]]).near_bodies(0.1))
        1 pair of bodies is only 0.01 apart at (0, 0, 0)
        """
        from adaptsize.remeshing.surface_checks import near_bodies

        return near_bodies(self._mesh, within, overlapping=overlapping)

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
        >>> from adaptsize import SimplexMesh
        >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [2, 0.2, 0]]
        >>> print(SimplexMesh(points, [[0, 1, 2], [3, 4, 5]]).overlapping_bodies())
        bodies 1 and 2 overlap: 2 triangles cross others, by up to 0.2 at (0.5, 0.2, 0)
        """
        from adaptsize.remeshing.surface_checks import overlapping_bodies

        return overlapping_bodies(self._mesh)

    @recorded("SimplexMesh.close_holes")
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

        >>> from adaptsize import SimplexMesh
        >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        >>> quads = [[0, 2, 6, 4], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]]
        >>> cells = [c for a, b, c, d in quads for c in ([a, b, c], [a, c, d])]
        >>> closed = SimplexMesh(points, cells).close_holes()
        >>> closed.is_closed, closed.n_cells
        (True, 12)
        """
        from adaptsize.remeshing.hole_filling import close_holes

        return close_holes(self._mesh)
