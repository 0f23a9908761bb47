"""Writing of meshes for Abaqus, CalculiX, Nastran and SU2."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.typing import IntArray

#: Linear elements by the dimensions of cells and space.
_ELEMENTS = {(1, 2): "T2D2", (1, 3): "T3D2", (2, 2): "CPS3", (2, 3): "S3", (3, 3): "C3D4"}
_CARDS = {1: "CROD", 2: "CTRIA3", 3: "CTETRA"}
_PER_LINE = 8
#: Numbers of VTK for segments, triangles and tetrahedra.
_VTK = {1: 3, 2: 5, 3: 10}


def write_abaqus(path: Path, mesh: SimplexMesh) -> None:
    """Write the cells, with a set of elements per tag, and a set of nodes per tag of facets.

    The sets have the names of the tags, or ``region1`` and ``boundary1``.
    """
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))
    numbered = [np.column_stack([np.arange(1, len(a) + 1), a]) for a in (points, mesh.cells + 1)]
    with open(path, "w", encoding="ascii") as file:
        file.write("*HEADING\nwritten by adaptsize\n*NODE\n")
        np.savetxt(file, numbered[0], fmt=["%d", *3 * ["%.16e"]], delimiter=", ")
        file.write(f"*ELEMENT, TYPE={_ELEMENTS[mesh.cell_dim, mesh.dim]}\n")
        np.savetxt(file, numbered[1], fmt="%d", delimiter=", ")
        for name, cells in _groups(mesh, mesh.cell_dim, mesh.cell_tags):
            _write_set(file, f"*ELSET, ELSET={name}\n", cells)
        for name, facets in _groups(mesh, mesh.cell_dim - 1, mesh.facet_tags):
            assert mesh.tagged_facets is not None
            _write_set(file, f"*NSET, NSET={name}\n", np.unique(mesh.tagged_facets[facets]))


def write_nastran(path: Path, mesh: SimplexMesh) -> None:
    """Write cells and tagged facets, with their tags as numbers of properties, which start at 1."""
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))
    blocks = [(mesh.cells, mesh.cell_tags)]
    if mesh.tagged_facets is not None:
        blocks.append((mesh.tagged_facets, mesh.facet_tags))
    with open(path, "w", encoding="ascii") as file:
        file.write("$ written by adaptsize\nBEGIN BULK\n")
        for number, (x, y, z) in enumerate(points.tolist(), 1):
            file.write(f"GRID*   {number:<16}{'':16}{x:16.9E}{y:16.9E}\n*       {z:16.9E}\n")
        number = 0
        for cells, tags in blocks:
            properties = np.ones(len(cells), np.int32) if tags is None else np.maximum(tags, 1)
            card = _CARDS[cells.shape[1] - 1]
            for row in np.column_stack([properties, cells + 1]).tolist():
                number += 1
                file.write("".join(f"{field:<8}" for field in (card, number, *row)) + "\n")
        file.write("ENDDATA\n")


def write_su2(path: Path, mesh: SimplexMesh) -> None:
    """Write the cells, and the tagged facets as markers with the names or numbers of the tags."""
    groups = list(_groups(mesh, mesh.cell_dim - 1, mesh.facet_tags, kind=""))
    with open(path, "w", encoding="ascii") as file:
        file.write(f"NDIME= {mesh.dim}\nNPOIN= {mesh.n_points}\n")
        np.savetxt(file, mesh.points, fmt="%.16e")
        file.write(f"NELEM= {mesh.n_cells}\n")
        _write_elements(file, mesh.cells)
        file.write(f"NMARK= {len(groups)}\n")
        for name, facets in groups:
            assert mesh.tagged_facets is not None
            file.write(f"MARKER_TAG= {name}\nMARKER_ELEMS= {len(facets)}\n")
            _write_elements(file, mesh.tagged_facets[facets])


def _write_set(file: TextIO, head: str, members: npt.NDArray[np.integer]) -> None:
    file.write(head)
    for first in range(0, len(members), _PER_LINE):
        row = members[first : first + _PER_LINE] + 1
        file.write(", ".join(map(str, row.tolist())) + "\n")


def _write_elements(file: TextIO, cells: IntArray) -> None:
    kind = np.full(len(cells), _VTK[cells.shape[1] - 1])
    np.savetxt(file, np.column_stack([kind, cells]), fmt="%d")


def _groups(
    mesh: SimplexMesh, dim: int, tags: IntArray | None, kind: str | None = None
) -> Iterator[tuple[str, npt.NDArray[np.intp]]]:
    """Yield the name of each tag, and the cells or facets that have it."""
    kind = ("region" if dim == mesh.cell_dim else "boundary") if kind is None else kind
    for tag in () if tags is None else np.unique(tags).tolist():
        name = mesh.tag_names.get((dim, tag), f"{kind}{tag}")
        # Solvers take letters, digits and underscores.
        yield re.sub(r"\W", "_", name, flags=re.ASCII)[:80], np.flatnonzero(tags == tag)
