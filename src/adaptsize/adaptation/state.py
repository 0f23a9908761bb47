"""The state of an adaptive loop in a file, from which it goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_path, check_type, describe
from adaptsize._formats.guards import about_file, check_readable, write_whole
from adaptsize.adaptation._fields import as_fields
from adaptsize.adaptation.element_fields import as_nodal_fields
from adaptsize.adaptation.given_fields import ElementField, QuadratureField
from adaptsize.background import SimplexMesh
from adaptsize.errors import MeshFileError

#: Version of the layout.
_LAYOUT = 1
_KINDS: dict[str, type] = {"element": ElementField, "quadrature": QuadratureField}
_ARRAYS = ("points", "cells", "cell_tags", "tagged_facets", "facet_tags")


@dataclass(frozen=True, eq=False)
class LoopState:
    """What an adaptive loop needs to go on later: mesh, fields, and the first mesh of the loop.

    Mesh files keep no values of other elements, and not the first mesh.

    Parameters
    ----------
    mesh : SimplexMesh
        If `adapt` made it, the first mesh of its loop goes with it.
    fields, cell_fields : mapping of str
        As in `adapt`, but for functions, and functions of scikit-fem.
    """

    mesh: SimplexMesh
    fields: Mapping[str, Any] = field(default_factory=dict)
    cell_fields: Mapping[str, Any] = field(default_factory=dict)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a file of arrays (``.npz``).

        It replaces one that is there when it is complete.

        Parameters
        ----------
        path : str or path-like

        Raises
        ------
        ValueError
            If the mesh is in parts, a field is none that a file keeps, or (MeshFileError) the file
            cannot be written.
        """
        target, mesh = as_path("path", path), self.mesh
        check_type("mesh", mesh, SimplexMesh)
        checked = as_nodal_fields(self.fields, mesh)
        content: dict[str, Any] = {"layout": np.array(_LAYOUT), **_of_mesh("mesh", mesh)}
        if mesh.original is not None:
            content |= _of_mesh("original", mesh.original)
        for name, array in checked.arrays.items():
            content[f"fields/array/{name}"] = array
        for name in checked.elements:
            content |= _of_field(name, self.fields[name])
        for name, array in as_fields("cell_fields", self.cell_fields, mesh.n_cells).items():
            content[f"cell_fields/{name}"] = array

        def write_to(path: Path) -> None:
            with path.open("wb") as file:
                np.savez_compressed(file, **content)

        try:
            write_whole(target, write_to)
        except (OSError, MeshFileError) as error:
            raise about_file(target, error) from error

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> LoopState:
        """Return what `write` wrote, the same to the last bit.

        Parameters
        ----------
        path : str or path-like

        Raises
        ------
        MeshFileError
            If there is no such file, or it is damaged.
        """
        source = as_path("path", path)
        try:
            check_readable(source)
        except MeshFileError as error:
            raise about_file(source, error) from error
        try:
            with np.load(source, allow_pickle=False) as held:
                content = {name: held[name] for name in held.files}
            if int(content.pop("layout")) != _LAYOUT:
                raise ValueError("another layout")
            mesh = _mesh_of("mesh", content)
            if "original/points" in content:
                mesh = mesh.with_original(_mesh_of("original", content))
            found = _parts(content, "fields/array/")
            for kind, make in _KINDS.items():
                parts = _parts(content, f"fields/{kind}/")
                for name in dict.fromkeys(key.partition("/")[2] for key in parts):
                    own = {k: parts[f"{k}/{name}"] for k in (p.name for p in fields_of(make))}
                    found[name] = make(**{k: v if v.ndim else v.item() for k, v in own.items()})
        except Exception as error:  # numpy and zipfile raise many kinds for damaged files
            text = MeshFileError(f"is not the state of an adaptive loop: {error!r}")
            raise about_file(source, text) from error
        return cls(mesh, found, _parts(content, "cell_fields/"))


def _of_mesh(prefix: str, mesh: SimplexMesh) -> dict[str, Any]:
    """Return the arrays of a mesh by name."""
    held = {f"{prefix}/{name}": getattr(mesh, name) for name in _ARRAYS}
    names = [[*key, name] for key, name in mesh.tag_names.items()]
    held[f"{prefix}/tag_names"] = np.array(json.dumps(names))
    for kind in ("point_data", "cell_data"):
        for name, values in getattr(mesh, kind).items():
            held[f"{prefix}/{kind}/{name}"] = values
    return {name: values for name, values in held.items() if values is not None}


def _mesh_of(prefix: str, content: Mapping[str, npt.NDArray[Any]]) -> SimplexMesh:
    """Return a mesh from its arrays."""
    names = json.loads(str(content[f"{prefix}/tag_names"]))
    held = _parts(content, f"{prefix}/")
    own: dict[str, Any] = {name: held[name] for name in _ARRAYS if name in held}
    return SimplexMesh(
        own.pop("points"), own.pop("cells"), **own,
        tag_names={(dim, tag): name for dim, tag, name in names},
        point_data=_parts(content, f"{prefix}/point_data/"),
        cell_data=_parts(content, f"{prefix}/cell_data/"),
    )  # fmt: skip


def _of_field(name: str, given: Any) -> dict[str, Any]:
    """Return the arrays of a field of finite elements by name."""
    kind = next((key for key, own in _KINDS.items() if isinstance(given, own)), None)
    if kind is None or callable(given.values):
        raise ValueError(
            f"fields[{name!r}] must be values, which a file keeps: for a function of scikit-fem "
            f"its x, for another one its ElementField on the mesh; got {describe(given)}"
        )
    parts = {part.name: np.asarray(getattr(given, part.name)) for part in fields_of(given)}
    return {f"fields/{kind}/{part}/{name}": values for part, values in parts.items()}


def _parts(content: Mapping[str, npt.NDArray[Any]], prefix: str) -> dict[str, Any]:
    """Return the arrays whose names begin with a prefix, without it."""
    return {k.removeprefix(prefix): v for k, v in content.items() if k.startswith(prefix)}
