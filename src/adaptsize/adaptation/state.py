"""The state of an adaptive loop in a file, from which it goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_path, check_type, describe
from adaptsize.adaptation._fields import Arrays, as_fields
from adaptsize.adaptation.cycle import ORIGINAL
from adaptsize.adaptation.element_fields import ElementField, QuadratureField, as_nodal_fields
from adaptsize.adaptation.report import AdaptResult
from adaptsize.background import SimplexMesh
from adaptsize.errors import MeshFileError

#: Version of the layout.
_LAYOUT = 1
_KINDS: dict[str, type] = {"element": ElementField, "quadrature": QuadratureField}
_ARRAYS = ("points", "cells", "cell_tags", "tagged_facets", "facet_tags")


class LoopState(NamedTuple):
    """What `read_state` returns."""

    mesh: SimplexMesh
    """It knows the first mesh of its loop, by the boundary of which `adapt` bounds sizes."""
    fields: dict[str, Any]
    cell_fields: Arrays


def write_state(
    path: str | os.PathLike[str],
    state: AdaptResult | SimplexMesh,
    *,
    fields: Mapping[str, Any] | None = None,
    cell_fields: Mapping[str, npt.ArrayLike] | None = None,
) -> None:
    """Write what an adaptive loop needs to go on later: mesh, fields and first mesh.

    Mesh files keep no values of other elements, and not the first mesh of the loop.

    Parameters
    ----------
    path : str or path-like
        File of arrays (``.npz``).  It replaces one that is there, when it is complete.
    state : AdaptResult or SimplexMesh
        What `adapt` returned, with its fields, or a mesh.
    fields, cell_fields : mapping of str, optional
        As in `adapt`, beside or instead of those of the result.

    Raises
    ------
    ValueError
        If a mesh is in parts, or a field is a function or one of scikit-fem.
    """
    target = as_path("path", path)
    check_type("state", state, AdaptResult, SimplexMesh)
    given, by_cell = dict(fields or {}), dict(cell_fields or {})
    mesh = state
    if isinstance(state, AdaptResult):
        mesh = state.mesh
        given, by_cell = {**state.fields, **given}, {**state.cell_fields, **by_cell}
    check_type("mesh", mesh, SimplexMesh)
    assert isinstance(mesh, SimplexMesh)
    checked = as_nodal_fields(given, mesh)
    content: dict[str, Any] = {"layout": np.array(_LAYOUT), **_of_mesh("mesh", mesh)}
    first = vars(mesh).get(ORIGINAL)
    if first is not None:
        content |= _of_mesh("original", first)
    for name, array in checked.arrays.items():
        content[f"fields/array/{name}"] = array
    for name in checked.elements:
        content |= _of_field(name, given[name])
    for name, array in as_fields("cell_fields", by_cell, mesh.n_cells).items():
        content[f"cell_fields/{name}"] = array
    partial = target.with_name(f"{target.name}.part")
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, **content)
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def read_state(path: str | os.PathLike[str]) -> LoopState:
    """Return the mesh and the fields that `write_state` wrote.

    Parameters
    ----------
    path : str or path-like

    Returns
    -------
    LoopState
        ``(mesh, fields, cell_fields)``, the same to the last bit.

    Raises
    ------
    MeshFileError
        If the file is no such file.
    """
    source = as_path("path", path)
    try:
        with np.load(source, allow_pickle=False) as held:
            content = {name: held[name] for name in held.files}
        if int(content.pop("layout")) != _LAYOUT:
            raise ValueError("another layout")
        mesh = _mesh_of("mesh", content)
        if "original/points" in content:
            vars(mesh)[ORIGINAL] = _mesh_of("original", content)
        found = _parts(content, "fields/array/")
        for kind, make in _KINDS.items():
            parts = _parts(content, f"fields/{kind}/")
            for name in dict.fromkeys(key.partition("/")[2] for key in parts):
                own = {k: parts[f"{k}/{name}"] for k in (part.name for part in fields_of(make))}
                found[name] = make(**{k: v if v.ndim else v.item() for k, v in own.items()})
    except (BadZipFile, KeyError, ValueError, EOFError) as error:
        raise MeshFileError(f"{Path(source)} is no state of an adaptive loop: {error}") from error
    return LoopState(mesh, found, _parts(content, "cell_fields/"))


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


def _of_field(name: str, field: Any) -> dict[str, Any]:
    """Return the arrays of a field of finite elements by name."""
    kind = next((key for key, own in _KINDS.items() if isinstance(field, own)), None)
    if kind is None or callable(field.values):
        raise ValueError(
            f"fields[{name!r}] must be values, which a file keeps: for a function of scikit-fem "
            f"its x, for another one its ElementField on the mesh; got {describe(field)}"
        )
    parts = {part.name: np.asarray(getattr(field, part.name)) for part in fields_of(field)}
    return {f"fields/{kind}/{part}/{name}": values for part, values in parts.items()}


def _parts(content: Mapping[str, npt.NDArray[Any]], prefix: str) -> dict[str, Any]:
    """Return the arrays whose names begin with a prefix, without it."""
    return {k.removeprefix(prefix): v for k, v in content.items() if k.startswith(prefix)}
