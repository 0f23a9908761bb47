"""Methods that convert meshes from and to those of other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from adaptsize.background.methods.group import MeshMethods

if TYPE_CHECKING:
    from adaptsize.background.simplex import SimplexMesh
    from adaptsize.distributed import DolfinxMesh


class ExchangeMethods(MeshMethods):
    """Meshes of other programs."""

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
        >>> from adaptsize import SimplexMesh
        >>> import trimesh
        >>> SimplexMesh.from_object(trimesh.creation.box())
        SimplexMesh(8 points in 3-D, 12 triangles)
        """
        from adaptsize.bridges.meshes import from_object

        return from_object(mesh, kind=kind, flatten=flatten)

    def like(self, other: Any) -> Any:
        """Return this mesh as an object of the program that another one is of.

        It closes the way of an object through a function: ``remesh(part, size).like(part)``.

        Parameters
        ----------
        other : object
            What `from_object` takes, or a SimplexMesh.  Not changed; only its type counts.

        Returns
        -------
        object
            What ``to_meshio``, ``to_pyvista`` and the other methods return.  For a mesh of NGSolve
            also that of NGSolve, for a mesh of DOLFINx without tags the mesh alone.

        Raises
        ------
        ValueError
            If the object is none of these, or the program cannot hold the mesh.

        Examples
        --------
        >>> import trimesh
        >>> from adaptsize import SimplexMesh
        >>> box = trimesh.creation.box()
        >>> SimplexMesh.from_object(box).like(box)
        <trimesh.Trimesh(vertices.shape=(8, 3), faces.shape=(12, 3))>
        """
        from adaptsize.bridges.meshes import like

        return like(self._mesh, other)

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

        return to_meshio(self._mesh, tag_name=tag_name)

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

        return to_pyvista(self._mesh)

    def to_trimesh(self) -> Any:
        """Return a ``trimesh.Trimesh`` of triangles in space, or of the boundary of tetrahedra.

        Points and triangles are in the same order.  Tags are left out.
        """
        from adaptsize.bridges.meshes import to_trimesh

        return to_trimesh(self._mesh)

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

        return to_dolfinx(self._mesh)

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

        return to_gmsh(self._mesh, name)

    def to_mfem(self) -> Any:
        """Return an ``mfem.ser.Mesh``, tags as attributes and their names as sets of attributes.

        Without tagged facets, the boundary has the attribute 1.

        Raises
        ------
        ValueError
            If a tag is negative, or 0 on a facet.
        """
        from adaptsize.bridges.solvers import to_mfem

        return to_mfem(self._mesh)

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

        return to_netgen(self._mesh)

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

        return to_skfem(self._mesh)
