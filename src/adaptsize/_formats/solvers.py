"""Writing of meshes for Abaqus, CalculiX, Nastran and SU2."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.text import write_text
from adaptsize.background import SimplexMesh
from adaptsize.typing import IntArray

#: Linear elements by the dimensions of cells and space.
_ELEMENTS = {(1, 2): "T2D2", (1, 3): "T3D2", (2, 2): "CPS3", (2, 3): "S3", (3, 3): "C3D4"}
#: Names of Nastran, and numbers of VTK, for segments, triangles and tetrahedra.
_CARDS, _VTK = {1: "CROD", 2: "CTRIA3", 3: "CTETRA"}, {1: 3, 2: 5, 3: 10}


def write_abaqus(path: Path, mesh: SimplexMesh) -> None:
    """Write the cells, with a set of elements per tag, and a set of nodes per tag of facets.

    The sets have the names of the tags, or ``region1`` and ``boundary1``.
    """
    pieces: list[Any] = [
        "*HEADING\nwritten by adaptsize\n*NODE\n",
        ("%d, %.16e, %.16e, %.16e\n", _numbered(_in_space(mesh))),
        f"*ELEMENT, TYPE={_ELEMENTS[mesh.cell_dim, mesh.dim]}\n",
        ("%d" + ", %d" * (mesh.cell_dim + 1) + "\n", _numbered(mesh.cells + 1)),
    ]
    for name, cells in _groups(mesh, mesh.cell_dim, mesh.cell_tags):
        pieces += [f"*ELSET, ELSET={name}\n", ("%d\n", cells + 1)]
    for name, facets in _groups(mesh, mesh.cell_dim - 1, mesh.facet_tags):
        assert mesh.tagged_facets is not None
        nodes = np.unique(mesh.tagged_facets[facets])
        pieces += [f"*NSET, NSET={name}\n", ("%d\n", nodes + 1)]
    write_text(path, *pieces)


def write_nastran(path: Path, mesh: SimplexMesh) -> None:
    """Write cells and tagged facets, with their tags as numbers of properties, which start at 1."""
    pieces: list[Any] = [
        "$ written by adaptsize\nBEGIN BULK\n",
        (f"GRID*   %-16d{'':16}%16.9E%16.9E\n*       %16.9E\n", _numbered(_in_space(mesh))),
    ]
    first = 1
    for cells, tags in ((mesh.cells, mesh.cell_tags), (mesh.tagged_facets, mesh.facet_tags)):
        if cells is not None:
            properties = np.ones(len(cells), np.int32) if tags is None else np.maximum(tags, 1)
            line = f"{_CARDS[cells.shape[1] - 1]:<8}{'%-8d' * (2 + cells.shape[1])}\n"
            pieces.append((line, _numbered(np.column_stack([properties, cells + 1]), first)))
            first += len(cells)
    write_text(path, *pieces, "ENDDATA\n")


def write_su2(path: Path, mesh: SimplexMesh) -> None:
    """Write the cells, and the tagged facets as markers with the names or numbers of the tags."""
    groups = list(_groups(mesh, mesh.cell_dim - 1, mesh.facet_tags, kind=""))
    pieces: list[Any] = [
        f"NDIME= {mesh.dim}\nNPOIN= {mesh.n_points}\n",
        (" ".join(["%.16e"] * mesh.dim) + "\n", mesh.points),
        f"NELEM= {mesh.n_cells}\n",
        (_su2_line(mesh.cells), mesh.cells),
        f"NMARK= {len(groups)}\n",
    ]
    for name, facets in groups:
        assert mesh.tagged_facets is not None
        own = mesh.tagged_facets[facets]
        pieces += [f"MARKER_TAG= {name}\nMARKER_ELEMS= {len(own)}\n", (_su2_line(own), own)]
    write_text(path, *pieces)


def _su2_line(cells: IntArray) -> str:
    return f"{_VTK[cells.shape[1] - 1]}{' %d' * cells.shape[1]}\n"


def _in_space(mesh: SimplexMesh) -> npt.NDArray[np.float64]:
    return np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))


def _numbered(rows: npt.NDArray[Any], first: int = 1) -> npt.NDArray[Any]:
    return np.column_stack([np.arange(first, first + len(rows)), rows])


def _groups(
    mesh: SimplexMesh, dim: int, tags: IntArray | None, kind: str | None = None
) -> Iterator[tuple[str, npt.NDArray[np.intp]]]:
    """Yield the name of each tag, and the cells or facets that have it."""
    kind = ("region" if dim == mesh.cell_dim else "boundary") if kind is None else kind
    for tag in () if tags is None else np.unique(tags).tolist():
        name = mesh.tag_names.get((dim, tag), f"{kind}{tag}")
        # Solvers take letters, digits and underscores.
        yield re.sub(r"\W", "_", name, flags=re.ASCII)[:80], np.flatnonzero(tags == tag)
