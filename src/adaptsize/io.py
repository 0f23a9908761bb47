"""Reading and writing of meshes, size functions and images."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import (
    as_flag,
    as_path,
    as_whole_number,
    check_type,
    describe,
    one_of,
    warn_caller,
)
from adaptsize._defaults import TOLERANCE
from adaptsize._formats import assembly, formats, sizes, writers
from adaptsize._formats.blocks import KINDS
from adaptsize._formats.guards import about_file, check_readable, is_special, write_whole
from adaptsize._formats.limited import read_limited
from adaptsize._messages import Message
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.image import Image
from adaptsize.errors import InputWarning, MeshFileError
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.quality.connections import are_doubtful, unconnected
from adaptsize.typing import Background

if TYPE_CHECKING:
    from adaptsize._formats.coastal.polygons import polygons

__all__ = ["polygons", "read", "read_image", "read_metric", "read_size", "write"]


def __getattr__(name: str) -> Any:
    """Return ``polygons``, which is imported on first use."""
    if name != "polygons":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from adaptsize._formats.coastal.polygons import polygons

    return polygons


@recorded("read", reads=True)
def read(
    path: str | os.PathLike[str],
    *,
    kind: str | None = None,
    flatten: bool = True,
    tags: str | None = None,
    errors: str | Sequence[str] = (),
    keep_slits: bool = False,
) -> SimplexMesh:
    """Return the mesh in a file.

    STL, OBJ, PLY, OFF, glTF, VTK, VTU, XDMF, Gmsh ``.msh``, Medit ``.mesh`` and ``.meshb``,
    Abaqus ``.inp``, Nastran ``.bdf``, SU2.  The suffix determines the format.  For others,
    `SimplexMesh.from_object` takes what meshio reads.

    Parameters
    ----------
    path : path-like
        The file.
    kind : {"tetrahedra", "triangles", "segments"}, optional
        Which cells to read.  By default those of the highest dimension.  With ``kind``, nodes
        that only belong to other cells of the file are left out.
    flatten : bool
        Whether triangles and segments whose third coordinates are all 0, up to rounding (1e-8 of
        their extent), become a mesh in the plane, which is the intention of files from 2-D
        programs.  Triangles at another height, or with a constant first or second coordinate, do so
        as well with a warning, except from formats for surfaces, such as STL.  The other two
        coordinates stay.
    tags : str, optional
        Name of the cell field that holds the tags of cells and facets.  By default a field with one
        of the names in the notes.
    errors : str or sequence of str
        Cell fields with errors, as for `adapt`.  Where a cell is split, its parts share the error
        by their measures, such that the squares add up.  Other fields are repeated.  Names that the
        file lacks have no effect.
    keep_slits : bool
        In plane and solid meshes of which most facets between cells are double, as programs for
        discontinuous fields write them, nodes at one place are joined.  True keeps them, and there
        are no warnings of cells that are not connected.

    Returns
    -------
    SimplexMesh
        Nodes are in the order of the file (for STL: of first appearance) and include nodes in
        no cell.  Tags and fields are described in the notes.

    Raises
    ------
    MeshFileError
        If the file is missing, empty, a device or pipe, damaged, of an unknown format or
        shorter than its header says, has no cells of the requested kind, coordinates that are not
        finite, or indices out of range.  The message is one line that names the file and the
        problem.
    OptionError
        If ``kind`` is unknown, or no cell field has the name ``tags``.

    Warns
    -----
    InputWarning
        If cells were dropped or converted, with their number.  If parts of a plane or solid mesh
        lie side by side and are not connected: nodes at one place, or nodes in the middle of an
        edge (hanging nodes), with their number and the first place.  Slits are not reported here,
        but by ``adaptsize info`` and `check_mesh`.

    Notes
    -----
    *Cells.*  Quadrilaterals are split into two triangles (along the shorter diagonal that lies
    inside).  Hexahedra, wedges and pyramids are split into tetrahedra such that neighbours match.
    Higher-order cells are reduced to their corners.  Cells that contain a node twice are
    dropped.  Flat cells with different nodes are kept.

    *Truncated files.*  Counts and end marks of each format are compared with what was read.  OBJ
    and Abaqus files have neither: after a cut between two lines, cells are missing without
    an error.

    *STL* files have no shared nodes.  Corners are one node if their coordinates are equal.  If
    edges do not meet then, corners are also joined, at their mean, up to a distance that is found
    from the triangles: the smallest one that closes the gaps, at most a tenth of the shortest edge,
    and at most 1e-6 of the diagonal if most edges do meet.  A warning has the distance.

    *Tags.*  The first integer cell field that is not zero everywhere, among the names that
    programs use (``cell_tags``, ``gmsh:physical``, ``medit:ref``, ``region``, ``material``,
    ``CellEntityIds``, ``ModelFaceID``, ``GeometryIds``, ``label``, ...), becomes ``cell_tags``.
    Case, separators and the plural make no difference.  Other fields stay in ``cell_data``; a
    warning lists integer fields if no tags were found.
    In the same way, cells of one dimension less (the triangles in a file of tetrahedra)
    become ``tagged_facets`` and ``facet_tags``.  Those that are not a facet of a cell
    are dropped with a warning.  If they have no tags, all are left out without a warning, as are
    cells of lower dimensions.  Names of Gmsh's physical groups become ``tag_names``.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "square.vtu")
    ...     write(file, square, fields={"h": [0.1, 0.2, 0.3, 0.2]})
    ...     mesh = read(file)
    >>> mesh
    SimplexMesh(4 points in 2-D, 2 triangles)
    >>> mesh.point_data["h"]
    array([0.1, 0.2, 0.3, 0.2])
    """
    file = as_path("path", path)
    flatten = as_flag("flatten", flatten)
    if kind is not None:
        one_of("kind", kind, tuple(KINDS))
    if tags is not None:
        check_type("tags", tags, str)
    keep_slits = as_flag("keep_slits", keep_slits)
    check_type("errors", errors, Sequence)
    shared = [errors] if isinstance(errors, str) else [*errors]
    notes: list[str] = []
    try:
        raw = formats.load(file)
        notes.extend(raw.notes)
        mesh = assembly.build(
            raw,
            kind=kind,
            flatten=flatten,
            notes=notes,
            tags=tags,
            errors=shared,
            keep_slits=keep_slits,
        )
    except (ValueError, MemoryError) as error:
        raise about_file(file, error) from error
    if not keep_slits:
        notes.extend(str(found) for found in are_doubtful(unconnected(mesh)))
    if notes:
        warn_caller(Message("{}: {}", file, Message.joined("; ", notes)), InputWarning)
    return mesh


def write(
    path: str | os.PathLike[str],
    obj: Background | SizeFunction | MetricFunction,
    *,
    fields: Mapping[str, npt.ArrayLike] | None = None,
    file_format: str | None = None,
    order: Literal[1, 2] = 1,
    record: bool = False,
) -> None:
    """Write a mesh, grid, octree or size function to a file.

    The file is written completely or not at all: under a temporary name in the same
    directory, then renamed.  If this fails, an existing file is unchanged.  Devices
    and pipes, such as ``/dev/stdout``, are written to directly.

    Parameters
    ----------
    path : path-like
        The file.  Its suffix determines the format.
    obj : SimplexMesh, CartesianGrid, Octree, SizeFunction or MetricFunction
        A size function is written as its background with the nodal field ``h``.  Where it grows
        off a surface or a line, the constant nodal fields ``h.g`` and ``h.hmax`` record it.  An
        octree is written as its ``mesh``, and so is a grid, except to ``.vti``.
    fields : mapping of str to array_like or callable, optional
        Nodal fields, one row per node (for a grid: of its shape), or functions of the points of
        a mesh, such as a SizeFunction.  They are written besides the fields of the mesh and replace
        fields of the same name.
    file_format : str, optional
        ``"vti"`` (grids only), ``"vtu"``, ``"vtk"``, ``"xdmf"`` (text, self-contained),
        ``"gmsh"`` (version 2.2), ``"medit"``, ``"ply"``, ``"stl"`` (binary), ``"obj"``,
        ``"off"``, ``"abaqus"`` (``.inp``, also for CalculiX), ``"nastran"`` (``.bdf``), ``"su2"``.
        Formats that hold only the sizes ``h`` or the metric are ``"gmsh-view"``
        (``.pos``), ``"medit-sol"`` (``.sol``, for Mmg) and, for sizes, ``"jigsaw"``
        (``.jig.msh``, because ``.msh`` is Gmsh's).
    order : {1, 2}, default 1
        Order of the cells.  2 adds a node in the middle of each edge, after the others; edges stay
        straight, and nodal fields have the mean of both ends there.  For ``.vtu``, ``.vtk``,
        ``.vtkhdf``, ``.msh``, ``.inp`` and ``.bdf``.
    record : bool
        Also write ``NAME.json``: the files read, with their SHA-256, the calls that made ``obj``,
        with their options, and the versions of packages.  ``adaptsize again NAME.json`` makes the
        file again.  Recorded are functions that read, that return sizes or limit them, `remesh`,
        `remesh_to_elements`, `mesh_image`, `mesh_from_distance`, `mesh_family`, `adapt`, and the
        methods ``tag_faces``, ``close_holes`` and ``without_data``.

    Raises
    ------
    ValueError
        If the suffix or ``file_format`` is unknown (the message lists the known ones), the
        format cannot hold the data, or sizes for a mesh generator are missing or not
        finite.
    MeshFileError
        If the file cannot be written.

    Warns
    -----
    InputWarning
        If the file cannot be made again from its record, because an argument was a function, or a
        mesh or more than 1000 numbers from elsewhere, such as errors from a solver, or more than
        500 calls in a row led to the result.  The record says which.

    Notes
    -----
    *Tags.*  VTU, VTK and XDMF hold cell tags and tagged facets as the cell field ``cell_tags``
    (facets are separate cells there), Gmsh as physical groups with their names, and Medit as
    references.  `read` restores them, but treats tags that are all 0 as no tags.  Gmsh ignores
    cells in no group, so untagged cells of a mesh with tags are written as a separate group.

    *Fields.*  Other cell fields are written only to VTU, VTK and XDMF, with NaN (integers: 0) on
    the facets.  Medit, STL, OBJ, OFF and solvers' formats hold no nodal fields.  For these the
    fields of the mesh are left out, and ``fields`` and size functions are refused.  PLY holds
    nodal fields of one component.

    *Cells.*  STL, OBJ, OFF and PLY hold only triangles without tags; for tetrahedra the boundary
    is written.  STL rounds to float32.  All formats except XDMF and Medit have z = 0 for 2-D
    meshes.  VTI is VTK's image data with numbers of full precision, 8 bytes each, and no cells.
    Inactive nodes are marked by ``vtkGhostType``, so that ParaView hides them.

    *Solvers.*  Abaqus files, also for CalculiX, have a set of elements per tag of cells.  Per tag
    of facets they have a set of nodes, and a surface for loads such as pressure (not on shells).
    ``Eall`` and ``Nall`` hold all elements and nodes.  In Nastran's, tags are numbers of
    properties, and coordinates have 10 digits.  In SU2's, tags of facets are markers.  Cells of
    negative measure, which solvers refuse, are turned.

    A Gmsh view holds sizes on the cells and nothing outside them.  JIGSAW takes triangles in
    the plane and tetrahedra.
    """
    # Resolve links, except to pipes: /dev/stdout may lead to one, which has no path.
    path = as_path("path", path)
    record = as_flag("record", record)
    if record and is_special(path):
        raise ValueError(f"record must be False for a device or a pipe, got {os.fspath(path)!r}")
    target = Path(os.path.realpath(path)) if not is_special(path) else path
    given = {"path": path, "obj": obj, "fields": fields, "file_format": file_format, "order": order}
    fields = _evaluated(obj, fields)
    chosen = formats.format_of(path, file_format)
    write_to = chosen.writer_of(
        path, obj, fields, as_whole_number("order", order, lower=1, upper=2)
    )
    lacking: list[str] = []

    def write_both(temporary: Path) -> None:
        write_to(temporary)
        if record:  # before the file gets its name: no file is left without its record
            lacking.extend(_record(path, temporary, given))

    try:
        write_whole(target, write_both)
    except (MeshFileError, OSError) as error:
        raise about_file(path, error) from error
    if lacking:
        text = f"{path}.json: the file cannot be made again from it: {'; '.join(lacking)}"
        warn_caller(text, InputWarning)


def _evaluated(obj: Any, fields: Any) -> Any:
    """Return nodal fields with the values of those that are functions."""
    if not (isinstance(fields, Mapping) and any(map(callable, fields.values()))):
        return fields
    mesh = writers.parts_of(obj, None)[0]
    if not isinstance(mesh, SimplexMesh):
        raise ValueError(f"fields may be functions for meshes, got them for {describe(obj)}")
    return {
        name: value(mesh.points) if callable(value) else value for name, value in fields.items()
    }


def _record(path: Path, written: Path, given: Mapping[str, Any]) -> list[str]:
    """Write the record of a file whose content is written elsewhere; return what it lacks."""
    from adaptsize import _calls, _records

    describe = _calls.Describer()
    call = _calls.call_of("write", {name: describe(one) for name, one in given.items()})
    mesh, origin = writers.parts_of(given["obj"], None)[0], _calls.origin_of(given["obj"])
    more: dict[str, float] = {"n_points": mesh.n_points, "n_cells": mesh.n_cells}
    if origin is not None and origin.call.function in ("remesh", "remesh_to_elements"):
        tolerance = origin.call.arguments.get("tolerance", TOLERANCE)
        if isinstance(tolerance, _calls.Numbers):
            tolerance = tolerance.values
        if not isinstance(tolerance, _calls.Unknown):
            more["tolerance"] = float(tolerance)
    return _records.record_calls(path, call, written, **more)


@recorded("read_size", reads=True)
def read_size(path: str | os.PathLike[str], *, name: str = "h") -> SizeFunction:
    """Return the size function in a file: a nodal field on a grid or on a mesh.

    Parameters
    ----------
    path : path-like
        A ``.vti`` file (VTK image data from `write`, ParaView or pyvista) gives a size
        function on a CartesianGrid.  Any other file for `read` gives one on a SimplexMesh.
    name : str, default "h"
        The nodal field.

    Returns
    -------
    SizeFunction
        Values written by `write` to ``.vti`` are restored exactly.  The growth off a surface or a
        line is restored from the fields ``h.g`` and ``h.hmax``.

    Raises
    ------
    MeshFileError
        As in `read`, and if there is no such field (the message lists the fields of the file),
        or its values are not sizes.

    Notes
    -----
    Image data may be text or binary, inline or appended, compressed by zlib or LZMA.  Nodes
    hidden by ``vtkGhostType`` are inactive.  An image of one plane at z = 0 is a 2-D grid.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> grid = CartesianGrid([0.0, 0.0], spacing=0.5, shape=(3, 3))
    >>> size = SizeFunction(grid, grid.sample(lambda x: 0.1 + x[:, 0]))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "size.vti")
    ...     write(file, size)
    ...     read_size(file)
    SizeFunction(sizes 0.1 to 1.1, on CartesianGrid(3 x 3 nodes, (0, 0) to (1, 1)))
    """
    file = as_path("path", path)
    background: SimplexMesh | CartesianGrid
    fields: Mapping[str, npt.NDArray[Any]]
    if file.suffix.lower() == ".vti":
        try:
            check_readable(file)
            formats.check_end(".vti", file.read_bytes())
            grid, fields = read_limited("vtk.read_image", file)
            background = CartesianGrid(**grid)
        except (ValueError, MemoryError) as error:
            raise about_file(file, error) from error
    else:
        background = read(file)
        fields = background.point_data
    if name not in fields:
        listed = ", ".join(fields) or "none"
        raise about_file(file, MeshFileError(f"has no nodal field {name!r} (found: {listed})"))
    try:
        return SizeFunction(background, fields[name], **writers.growth_in(fields, name))
    except ValueError as error:
        raise about_file(file, MeshFileError(f"{name}: {error}")) from error


@recorded("read_metric", reads=True)
def read_metric(path: str | os.PathLike[str], *, name: str = "metric") -> Metric:
    """Return the metric in a file: a nodal field of matrices, or Mmg's ``.sol``.

    Parameters
    ----------
    path : path-like
        A ``.sol`` with sizes or symmetric matrices at the nodes, or a file for `read`.
    name : str, default "metric"
        The nodal field in a file for `read`, with one, four or nine components.

    Returns
    -------
    Metric
        At the nodes in the order of the file.

    Raises
    ------
    MeshFileError
        As in `read`, and if there is no such field, or its values are not metrics.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> from adaptsize.metrics import Metric, MetricFunction
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    >>> metric = Metric([[0.1, 1.0]] * 3, [np.eye(2)] * 3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "part.sol")
    ...     write(file, MetricFunction(mesh, metric))
    ...     read_metric(file)
    Metric(3 nodes in 2-D, sizes 0.1 to 1, aspect ratio up to 10)
    """
    file = as_path("path", path)
    try:
        if file.suffix.lower() == ".sol":
            check_readable(file)
            return sizes.read_sol(file)
        mesh = read(file)
        if name not in mesh.point_data:
            listed = ", ".join(mesh.point_data) or "none"
            raise MeshFileError(f"has no nodal field {name!r} (found: {listed})")
        return sizes.metric_in(mesh.point_data[name], mesh.dim)
    except ValueError as error:
        raise about_file(file, error) from error


@recorded("read_image", reads=True)
def read_image(path: str | os.PathLike[str], *, name: str | None = None) -> Image:
    """Return the picture or volume in a file, axis 0 along x.

    Parameters
    ----------
    path : path-like
        PNG, BMP, GIF, JPEG, PGM; TIFF, also stacks; NIfTI (``.nii``, ``.nii.gz``), NRRD;
        ``.npy``, ``.npz`` (optionally with the arrays ``spacing`` and ``origin``).
    name : str, optional
        Name of the array in an ``.npz`` file.  By default the only array of 2 or 3 dimensions,
        or the one named ``labels``, ``mask``, ``image`` or similar.

    Returns
    -------
    Image
        With ``values``, ``spacing`` and ``origin``.

    Raises
    ------
    MeshFileError
        If the file is missing, damaged or of an unknown format, has colours or transparent
        parts, does not hold a single picture or volume, or if its reader is not installed.

    Warns
    -----
    InputWarning
        If only part of the file was read, or the axes of a volume are oblique in space.

    Notes
    -----
    *Pictures* are oriented with x to the right and y upwards.  In a picture with a palette, the
    indices are the labels.  Grey pictures stored as colours are converted to grey.

    *Stacks* have x to the right, y downwards, and z from page to page, which is a right-handed
    system.  Their spacing is that of ImageJ or OME metadata.  The printer's resolution is
    ignored.

    *Volumes* of NIfTI and NRRD are permuted and mirrored such that their axes are those of their
    space, whose origin and unit are kept.  For NIfTI, x points to the right, y to the front and z
    upwards.  For NRRD the file defines the space.  *NumPy* arrays are not changed: axis 0 is
    along x.

    Whole numbers stored as floats are converted to integers, which are labels.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "mask.npz")
    ...     np.savez(file, labels=np.eye(3, dtype=int), spacing=[0.5, 1.0])
    ...     read_image(file)
    Image(3 x 3 pixels of int64, spacing 0.5, 1)
    """
    file = as_path("path", path)
    try:
        check_readable(file)
        found = read_limited("raster.load", file, name)
        image = Image(found.values, found.spacing, found.origin)
    except (ValueError, MemoryError) as error:
        raise about_file(file, error) from error
    if found.notes:
        warn_caller(f"{file}: {'; '.join(found.notes)}", InputWarning)
    return image
