"""Meshes and nodal fields from and to files."""

from __future__ import annotations

import os
import secrets
import shutil
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import one_of
from adaptsize._formats import readers, writers
from adaptsize._formats.blocks import (
    KINDS,
    RawMesh,
    Simplices,
    dimension_of,
    gather,
    plural,
    simplices_of,
)
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import facets_of, unique_rows
from adaptsize.errors import MeshFileError, MeshRepairWarning
from adaptsize.size_function import SizeFunction

# Names under which programs keep the region of a cell, the likeliest first.
_TAG_NAMES = (
    "cell_tags",
    "gmsh:physical",
    "medit:ref",
    "region",
    "regions",
    "material",
    "materialids",
    "avsucd:material",
    "tetgen:ref",
    "nastran:ref",
    "su2:tag",
    "netgen:index",
    "tag",
    "tags",
    "cell_markers",
    "facet_tags",
    "boundary",
    "ref",
    "attribute",
    "gmsh:geometrical",
)


def read(
    path: str | os.PathLike[str], *, kind: str | None = None, flatten: bool = True
) -> SimplexMesh:
    """Return the mesh in a file, in any format that meshio or trimesh reads.

    STL, OBJ, PLY, OFF, VTK, VTU, Gmsh ``.msh``, Medit ``.mesh`` and ``.meshb``, XDMF,
    Abaqus, Nastran, SU2, glTF and more, told by the suffix.

    Parameters
    ----------
    path : path-like
        The file.
    kind : {"tetrahedra", "triangles", "segments"}, optional
        Which cells to take; those of the highest dimension by default.  If others are
        asked for, nodes that belong to cells of the file but to none of these are left out.
    flatten : bool
        Whether triangles and segments whose third coordinates are all exactly 0 become
        a mesh in the plane, as files of 2-D programs are meant.

    Returns
    -------
    SimplexMesh
        Nodes in the order of the file (of an STL file: of first appearance), also those in
        no cell.  Tags and fields as told in the notes.

    Raises
    ------
    MeshFileError
        If the file is missing, empty, damaged, of an unknown kind, holds no cells of the
        kind wanted, or has coordinates that are not finite or indices out of range.  One
        line that names the file and what is wrong.
    ValueError
        If ``kind`` is another word.

    Warns
    -----
    MeshRepairWarning
        If cells were dropped or converted, with their number.

    Notes
    -----
    *Cells.*  Quadrilaterals become two triangles (cut along the shorter diagonal that lies
    inside).  Hexahedra, wedges and pyramids become tetrahedra so that neighbours match.
    Of cells of higher order the corners are taken and the other nodes left out.  Cells
    that name a node twice are dropped; flat ones with different nodes are kept.

    *STL* has no shared nodes: corners are merged where their coordinates are equal, not
    where they are close.

    *Tags.*  The first integer cell field that is not zero everywhere, of the names that
    programs use (``cell_tags``, ``gmsh:physical``, ``medit:ref``, ``region``, ``tag``,
    ``gmsh:geometrical``, ...), becomes ``cell_tags``; other fields stay in ``cell_data``.
    In the same way cells of one dimension less (the triangles in a file of tetrahedra)
    give ``tagged_facets`` and ``facet_tags``.  Of these, ones that are no facet of a cell
    are dropped with a warning, and without tags all are left out silently, as are
    cells of still lower dimension and the names of groups.

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
    file = Path(path)
    if kind is not None:
        one_of("kind", kind, tuple(KINDS))
    _check_readable(file)
    notes: list[str] = []
    try:
        raw = readers.load(file)
        notes.extend(raw.notes)
        mesh = _build(raw, _wanted_dimension(raw, kind), kind, flatten, notes)
    except (ValueError, MemoryError) as error:
        raise MeshFileError(f"{file}: {error}") from error
    if notes:
        warnings.warn(f"{file}: {'; '.join(notes)}", MeshRepairWarning, stacklevel=2)
    return mesh


def write(
    path: str | os.PathLike[str],
    obj: SimplexMesh | SizeFunction,
    *,
    fields: Mapping[str, npt.ArrayLike] | None = None,
    file_format: str | None = None,
) -> None:
    """Write a mesh, or a size function, to a file.

    The file is written whole or not at all: under a temporary name in the same
    directory, then renamed.  If anything fails, a file of that name stays as it was.

    Parameters
    ----------
    path : path-like
        The file; its suffix tells the format.
    obj : SimplexMesh or SizeFunction
        A size function is written as its mesh with the nodal field ``h``.
    fields : mapping of str to array_like, optional
        Nodal fields, one row per node, to write besides those of the mesh, or in place
        of those of the same name.
    file_format : str, optional
        ``"vtu"``, ``"vtk"``, ``"xdmf"`` (text, self-contained), ``"gmsh"`` (version 2.2),
        ``"medit"``, ``"ply"``, ``"stl"`` (binary), ``"obj"``, ``"off"``; for the sizes ``h``
        alone ``"gmsh-view"`` (``.pos``), ``"medit-sol"`` (``.sol``, for mmg) and
        ``"jigsaw"`` (``.jig.msh``, as ``.msh`` is Gmsh's).

    Raises
    ------
    ValueError
        If the suffix or ``file_format`` is unknown (the message lists what can be
        written), the format cannot hold what is asked for, or sizes for a mesh
        generator are missing or not finite.
    MeshFileError
        If the file cannot be written.

    Notes
    -----
    Cell tags and tagged facets are written to VTU, VTK and XDMF as the cell field
    ``cell_tags`` (facets are cells of their own there), to Gmsh as physical groups, to
    Medit as references; `read` finds them again, but takes tags that are all 0 for none.
    Other cell fields are written to VTU, VTK and XDMF only, NaN (integers: 0) on the facets.

    Medit, STL, OBJ and OFF hold no nodal fields: those of the mesh are left out, ``fields``
    and size functions are refused.  PLY holds nodal fields of one component.  STL, OBJ, OFF
    and PLY hold triangles only, without tags: of tetrahedra the boundary is written.  STL
    rounds to float32.  All but XDMF and Medit have z = 0 for 2-D meshes.

    A Gmsh view says sizes on the cells, nothing outside them.  JIGSAW takes triangles in
    the plane and tetrahedra.
    """
    target = Path(os.path.realpath(path))
    chosen = writers.format_of(Path(path), file_format)
    mesh, needed = _as_mesh(obj, fields)
    if needed and not chosen.holds_fields:
        raise ValueError(
            f"{Path(path).name} cannot hold nodal fields, got {', '.join(needed)}; "
            "write .vtu, or .sol for the sizes beside a .mesh"
        )
    others = [name for name in needed if name != "h"]
    if others and chosen.only_sizes:
        raise ValueError(
            f"{Path(path).name} holds sizes only, as the field 'h', got {', '.join(others)}"
        )
    try:
        _write_whole(target, mesh, chosen)
    except MeshFileError as error:
        raise MeshFileError(f"{path}: {error}") from error
    except OSError as error:
        raise MeshFileError(f"{path}: {error.strerror or error}") from error


def _write_whole(target: Path, mesh: SimplexMesh, chosen: writers.Format) -> None:
    """Write under a temporary name in the same directory and rename; raises OSError."""
    if target.is_dir():
        raise MeshFileError("is a directory")
    if not target.parent.is_dir():
        raise MeshFileError(f"there is no directory {target.parent}")
    # Not tempfile: its files are private to the user, and the suffix must stay.
    temporary = target.with_name(f".adaptsize-{secrets.token_hex(8)}{target.suffix}")
    try:
        chosen.write(temporary, mesh)
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def _as_mesh(
    obj: SimplexMesh | SizeFunction, fields: Mapping[str, npt.ArrayLike] | None
) -> tuple[SimplexMesh, list[str]]:
    """Return the mesh with all its fields, and the names of those that must be written."""
    nodal: dict[str, npt.ArrayLike] = {}
    mesh: object = obj
    if isinstance(obj, SizeFunction):
        mesh = obj.background
        nodal["h"] = obj.values
    if not isinstance(mesh, SimplexMesh):
        raise ValueError(f"obj must be a SimplexMesh or a SizeFunction on one, got {mesh!r}")
    nodal.update(fields or {})
    return mesh.with_data(point_data=nodal), list(nodal)


def _check_readable(file: Path) -> None:
    if file.is_dir():
        raise MeshFileError(f"{file}: is a directory")
    try:
        with file.open("rb") as opened:
            empty = not opened.read(1)
    except OSError as error:
        raise MeshFileError(f"{file}: {error.strerror or error}") from error
    if empty:
        raise MeshFileError(f"{file}: is empty")


def _wanted_dimension(raw: RawMesh, kind: str | None) -> int:
    present = {dimension_of(cell_type) for cell_type, cells in raw.blocks if len(cells)}
    dim = max(present) if kind is None else KINDS[kind]
    if dim not in present or dim == 0:
        found = ", ".join(f"{len(c)} {plural(t)}" for t, c in raw.blocks if len(c))
        raise MeshFileError(f"holds no {kind or 'cells but points'} (found {found})")
    return dim


def _build(
    raw: RawMesh, dim: int, kind: str | None, flatten: bool, notes: list[str]
) -> SimplexMesh:
    """Return the simplices of dimension ``dim`` with their tags and fields."""
    simplices = _without_repeated_nodes(simplices_of(raw, dim), notes)
    tag_name, cell_tags = _tags(raw, simplices)
    facets, facet_tags = _facets(raw, simplices, notes)
    cell_data = _cell_fields(raw, simplices, tag_name)
    cells = simplices.cells
    keep = _kept_nodes(raw, cells, reduced=kind is not None or bool(simplices.notes))
    if not keep.all():
        number = np.cumsum(keep) - 1
        cells = number[cells]
        facets = None if facets is None else number[facets]
    points = raw.points[keep]
    if flatten and dim < 3 and points.shape[1] == 3 and not points[:, 2].any():
        points = points[:, :2]
    return SimplexMesh(
        points,
        cells,
        cell_tags=cell_tags,
        tagged_facets=facets,
        facet_tags=facet_tags,
        point_data={name: values[keep] for name, values in _nodal_fields(raw).items()},
        cell_data=cell_data,
    )


def _without_repeated_nodes(simplices: Simplices, notes: list[str]) -> Simplices:
    """Drop cells that name a node twice; ``notes`` gets all that was done to the cells."""
    ordered = np.sort(simplices.cells, axis=1)
    good = (ordered[:, 1:] != ordered[:, :-1]).all(axis=1)
    cells, block, row, own_notes = simplices
    if not good.any():
        raise MeshFileError("holds only cells that name a node twice")
    if not good.all():
        own_notes = [*own_notes, f"{np.count_nonzero(~good)} cells that name a node twice dropped"]
        cells, block, row = cells[good], block[good], row[good]
    notes.extend(own_notes)
    return Simplices(cells, block, row, own_notes)


def _kept_nodes(raw: RawMesh, cells: npt.NDArray[Any], *, reduced: bool) -> npt.NDArray[np.bool_]:
    """Tell the nodes to keep: all, but for those that only cells left out belong to."""
    keep = np.ones(len(raw.points), bool)
    if reduced:
        for _, found in raw.blocks:
            if found.dtype != object:
                keep[found] = False
        keep[cells] = True
    return keep


def _cell_fields(
    raw: RawMesh, simplices: Simplices, tag_name: str | None
) -> dict[str, npt.NDArray[Any]]:
    """Return the cell data that are numbers, but for the tags and tags that are all 0."""
    fields = {}
    for name, blocks in raw.cell_data.items():
        values = gather(blocks, simplices)
        if name in (tag_name, "obj:group_ids") or values is None:
            continue
        if values.dtype.kind in "biuf" and (name.lower() not in _TAG_NAMES or values.any()):
            fields[name] = _native(values)
    return fields


def _nodal_fields(raw: RawMesh) -> dict[str, npt.NDArray[Any]]:
    """Return the point data that are numbers, one row per node, and say something."""
    fields = {}
    for name, values in raw.point_data.items():
        array = np.asarray(values)
        fits = array.ndim > 0 and len(array) == len(raw.points) and array.dtype.kind in "biuf"
        # Gmsh's entity numbers, and the references 0 that each Medit file has.
        empty = name == "gmsh:dim_tags" or (name == "medit:ref" and not array.any())
        if fits and not empty:
            fields[name] = _native(array)
    return fields


def _native(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the array in the byte order of the machine; legacy VTK files have the other."""
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def _tags(raw: RawMesh, simplices: Simplices) -> tuple[str | None, npt.NDArray[np.int32] | None]:
    """Return the likeliest tags of the simplices and the name they had."""
    by_name = {name.lower(): name for name in raw.cell_data}
    for wanted in _TAG_NAMES:
        if wanted not in by_name or not len(simplices.cells):
            continue
        values = gather(raw.cell_data[by_name[wanted]], simplices)
        if values is None or values.size != len(values) or values.dtype.kind not in "iuf":
            continue
        values = values.reshape(-1)
        integer = np.isfinite(values).all() and (values == np.floor(values)).all()
        if integer and values.any() and np.abs(values).max() < 2**31:
            return by_name[wanted], values.astype(np.int32)
    return None, None


def _facets(
    raw: RawMesh, simplices: Simplices, notes: list[str]
) -> tuple[npt.NDArray[Any] | None, npt.NDArray[np.int32] | None]:
    """Return the tagged cells of one dimension less that are facets of the simplices."""
    dim = simplices.cells.shape[1] - 1
    if not any(dimension_of(t) == dim - 1 and len(c) for t, c in raw.blocks) or dim == 1:
        return None, None
    found = simplices_of(raw, dim - 1)
    _, tags = _tags(raw, found)
    if tags is None:
        return None, None
    n_points = len(raw.points)
    facets = facets_of(simplices.cells.astype(np.int32), n_points)[0]
    rows = np.concatenate([facets, found.cells.astype(np.int32)])
    number = unique_rows(rows, n_points)[1]
    known = np.zeros(int(number.max()) + 1, bool)
    known[number[: len(facets)]] = True
    good = known[number[len(facets) :]]
    if not good.all():
        notes.append(f"{np.count_nonzero(~good)} tagged facets that bound no cell dropped")
    if not good.any():
        return None, None
    return found.cells[good], tags[good]
