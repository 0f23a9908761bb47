"""Reading of XDMF: one grid, or a mesh with functions and tags in further grids, as of DOLFINx.

meshio reads files of one grid.  Each of several grids is passed to it alone.
"""

import copy
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh, dimension_of
from adaptsize._formats.foreign import raw_of_meshio, refuse_links
from adaptsize.errors import MeshFileError

#: In any namespace: DOLFINx writes https, others http.
_INCLUDE = "{*}include"
_NAME = re.compile(r"@Name\s*=\s*['\"](.*?)['\"]")
#: The tags of cells and facets are one field.
_TAGS = "cell_tags"

#: Types that DOLFINx and meshio spell in different ways.
_TYPES = {"polyline": "Polyline", "polyvertex": "Polyvertex"}


@dataclass
class _Grid:
    """A uniform grid; what it includes from another one is resolved."""

    name: str
    topology: Any
    geometry: Any
    attributes: list[Any] = field(default_factory=list)


def read(path: Path) -> RawMesh:
    """Return the mesh in a file with the fields on it.

    Grids that include the points and cells of another one have fields on these, of several time
    steps the last.  Grids that include the points only have tags of their cells.

    Raises
    ------
    MeshFileError
        If the file is damaged, or has several meshes.
    """
    import meshio

    refuse_links(path)
    root = ElementTree.fromstring(path.read_bytes())
    grids = [grid for grid in root.iter("Grid") if grid.get("GridType", "Uniform") == "Uniform"]
    if len(grids) < 2 and root.find(f".//{_INCLUDE}") is None:
        return _with_scalars(raw_of_meshio(meshio.read(path)))
    resolved = [_resolved(grid, grids) for grid in grids]
    base = resolved[0]
    others = [grid.name for grid in resolved if grid.geometry is not base.geometry]
    if others:
        raise MeshFileError(
            f"holds several meshes ({', '.join(map(repr, [base.name, *others][:4]))}); one with "
            "fields on it can be read"
        )
    notes: list[str] = []
    with_fields = [grid for grid in resolved if grid.topology is base.topology]
    base.attributes = list(_last_steps(with_fields, notes))
    raw = _read_alone(base, root, path)
    raw.notes += notes
    for grid in resolved:
        if grid.topology is not base.topology:
            _add_tags(raw, _read_alone(grid, root, path))
    return raw


def _resolved(grid: Any, grids: list[Any]) -> _Grid:
    """Return a grid with the topology and geometry that it has or includes."""
    found = {part: grid.find(part) for part in ("Topology", "Geometry")}
    for include in grid.findall(_INCLUDE):
        pointer = include.get("xpointer", "")
        named = _NAME.search(pointer)
        for part in [part for part, element in found.items() if element is None]:
            if part not in pointer:
                continue
            sources = [g.find(part) for g in grids if not named or g.get("Name") == named[1]]
            sources += [g.find(part) for g in grids]  # a collection has the name
            found[part] = next((source for source in sources if source is not None), None)
    name = grid.get("Name", "")
    for part, element in found.items():
        if element is None:
            raise MeshFileError(f"has the grid {name!r} without its {part}")
    return _Grid(name, found["Topology"], found["Geometry"], grid.findall("Attribute"))


def _last_steps(grids: list[_Grid], notes: list[str]) -> Iterator[Any]:
    """Yield the last attribute of each name."""
    steps: dict[str, list[Any]] = {}
    for grid in grids:
        for attribute in grid.attributes:
            steps.setdefault(attribute.get("Name", ""), []).append(attribute)
    for name, found in steps.items():
        if len(found) > 1:
            notes.append(f"of the {len(found)} time steps of {name!r} the last is kept")
        yield found[-1]


def _read_alone(grid: _Grid, root: Any, path: Path) -> RawMesh:
    """Return the mesh of a grid as that of a file of its own."""
    import meshio

    alone = ElementTree.Element("Xdmf", root.attrib)
    domain = ElementTree.SubElement(alone, "Domain")
    made = ElementTree.SubElement(domain, "Grid", {"Name": "grid", "GridType": "Uniform"})
    made.extend(copy.deepcopy(part) for part in (grid.topology, grid.geometry, *grid.attributes))
    topology = made[0]
    kind = topology.get("TopologyType", topology.get("Type", ""))
    topology.set("TopologyType", _TYPES.get(kind.lower(), kind))
    for item in made.iter("DataItem"):
        if item.get("Format", "XML").upper() != "XML":
            item.text = str(path.parent.absolute() / (item.text or "").strip())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "grid.xdmf")
        ElementTree.ElementTree(alone).write(file)
        return _with_scalars(raw_of_meshio(meshio.read(file)))


def _with_scalars(raw: RawMesh) -> RawMesh:
    """Return the mesh with fields of one component as numbers, not as rows of one."""

    def flat(values: Any) -> npt.NDArray[Any]:
        array = np.asarray(values)
        return array[:, 0] if array.ndim == 2 and array.shape[1] == 1 else array

    raw.point_data = {name: flat(values) for name, values in raw.point_data.items()}
    raw.cell_data = {name: [*map(flat, parts)] for name, parts in raw.cell_data.items()}
    return raw


def _add_tags(raw: RawMesh, tagged: RawMesh) -> None:
    """Add the tags of the cells of another grid: to the same cells, or as cells of their own."""
    top = max(dimension_of(kind) for kind, _ in raw.blocks)
    names = [name for name in tagged.cell_data if _is_whole(tagged.cell_data[name])]
    if not names:
        return
    name = names[0]
    for (kind, cells), values in zip(tagged.blocks, tagged.cell_data[name], strict=True):
        tags = np.asarray(values).ravel().astype(np.int64)
        own = _TAGS
        if dimension_of(kind) < top:
            _append(raw, kind, cells, tags)
            continue
        if own in raw.cell_data and any(part.any() for part in raw.cell_data[own][:1]):
            own = name  # further tags of cells are a field
        of_blocks = list(
            raw.cell_data.get(own, [np.zeros(len(c), np.int64) for _, c in raw.blocks])
        )
        for k, (other, rows) in enumerate(raw.blocks):
            if other == kind:
                of_blocks[k] = _tags_of_rows(rows, cells, tags)
        raw.cell_data = {**raw.cell_data, own: of_blocks}


def _is_whole(parts: Any) -> bool:
    return all(
        np.asarray(part).dtype.kind in "iu" or (np.asarray(part) == np.floor(part)).all()
        for part in parts
    )


def _append(raw: RawMesh, kind: str, cells: npt.NDArray[Any], tags: npt.NDArray[Any]) -> None:
    """Append tagged cells; other cell fields are nan or 0 there."""
    before = {_TAGS: [np.zeros(len(rows), np.int64) for _, rows in raw.blocks]} | dict(
        raw.cell_data
    )
    for name, parts in before.items():
        first = np.asarray(parts[0])
        fill = np.nan if first.dtype.kind == "f" else 0
        more = np.full((len(cells), *first.shape[1:]), fill, first.dtype)
        before[name] = [*parts, tags if name == _TAGS else more]
    raw.cell_data = before
    raw.blocks.append((kind, cells))


def _tags_of_rows(
    rows: npt.NDArray[Any], cells: npt.NDArray[Any], tags: npt.NDArray[Any]
) -> npt.NDArray[np.int64]:
    """Return the tag of each row of nodes, 0 for those that are none of the tagged cells."""
    both = np.sort(np.concatenate([rows, cells]), axis=1)
    number = np.unique(both, axis=0, return_inverse=True)[1].ravel()
    of_number = np.zeros(int(number.max()) + 1, np.int64)
    of_number[number[len(rows) :]] = tags
    return of_number[number[: len(rows)]]
