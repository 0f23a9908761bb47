"""Methods that describe a mesh and its cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adaptsize.background.methods.group import MeshMethods
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from adaptsize.metrics.metric import Metric
    from adaptsize.quality.summary import MeshSummary


class QualityMethods(MeshMethods):
    """Counts, quality and metrics of a mesh."""

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
        >>> from adaptsize import SimplexMesh
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
        >>> summary = mesh.summarize()
        >>> summary.n_boundary_facets, summary.measure, summary.angle_min
        (4, 1.0, 45.0)
        """
        from adaptsize.quality.summary import summarize

        return summarize(self._mesh)

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
        >>> from adaptsize import SimplexMesh
        >>> SimplexMesh([[0, 0], [1, 0], [0.5, 0.75**0.5]], [[0, 1, 2]]).radius_ratios().round(12)
        array([1.])
        """
        from adaptsize.quality.elements import radius_ratios

        return radius_ratios(self._mesh)

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
        >>> from adaptsize import SimplexMesh
        >>> SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]).minimum_angles().round(12)
        array([45.])
        """
        from adaptsize.quality.elements import minimum_angles

        return minimum_angles(self._mesh)

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

        >>> import numpy as np
        >>> from adaptsize import Metric, SimplexMesh
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [0.5, 5 * np.sqrt(3)]], [[0, 1, 2]])
        >>> stretched = Metric([[1.0, 10.0]] * 3, [np.eye(2)] * 3)
        >>> mesh.metric_qualities(stretched).round(12)
        array([1.])
        >>> mesh.metric_qualities(Metric.isotropic([1.0, 1.0, 1.0], 2)).round(3)
        array([0.198])
        """
        from adaptsize.quality.elements import metric_qualities

        return metric_qualities(self._mesh, metric)

    def sizes(self) -> FloatArray:
        """Return the mean length of the edges at each node: the size that the mesh has there.

        Returns
        -------
        ndarray of float64, shape (n_points,)
            inf at nodes in no cell.  ``SizeFunction(mesh, mesh.sizes())`` is the size function that
            the mesh follows, for instance to remesh another mesh like it, or for a `time_step`.

        Examples
        --------
        >>> from adaptsize import SimplexMesh
        >>> SimplexMesh([[0, 0], [1, 0], [0, 2]], [[0, 1, 2]]).sizes().round(3)
        array([1.5  , 1.618, 2.118])
        """
        mesh = self._mesh
        total, count = (
            np.bincount(mesh.edges.ravel(), np.repeat(of_edge, 2), mesh.n_points)
            for of_edge in (mesh.edge_lengths, np.ones(len(mesh.edges)))
        )
        h = np.full(mesh.n_points, np.inf)
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
        >>> from adaptsize import SimplexMesh
        >>> mesh = SimplexMesh([[0, 0], [1, 0], [0.5, 5 * np.sqrt(3)]], [[0, 1, 2]])
        >>> metric = mesh.implied_metric()
        >>> metric.sizes.round(12), metric.aspect_ratio.round(12)
        (array([[ 1., 10.]]), array([10.]))
        """
        from adaptsize.metrics.implied import implied_metric

        return implied_metric(self._mesh)
