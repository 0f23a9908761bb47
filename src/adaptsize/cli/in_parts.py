"""``limit`` and ``remesh`` on distributed meshes, on several ranks of MPI."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from adaptsize._checks import as_limits
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize.cli.console import Console
from adaptsize.cli.files import Content, check_files, nodal_field
from adaptsize.cli.options import Given
from adaptsize.options import PartsOptions, options_of

if TYPE_CHECKING:
    from adaptsize.distributed import PartitionedMesh
    from adaptsize.typing import FloatArray

#: Options that are passed on to `adaptsize.remesh`.
_OF_MESHING = {"tolerance", "max_elements", "timeout", *options_of(PartsOptions)}


def runs_in_parts(console: Console, file: Path, output: Path, given: Given) -> bool:
    """Return whether a command runs on a distributed mesh."""
    return "mpi" in given or console.world is not None


def _check_options(given: Given, allowed: set[str]) -> None:
    """Refuse options, and values of them, that are not available for distributed meshes."""
    refused = [f"--{name.replace('_', '-')}" for name in given if name not in allowed]
    if given.get("target") == "triangles":
        refused.append("--target triangles")
    if given.get("backend", "auto") not in ("auto", "mmg"):
        refused.append(f"--backend {given['backend']}")
    if refused:
        raise ValueError(f"{', '.join(refused)} is not available for distributed meshes")


def _read(
    console: Console, file: Path, output: Path, content: Content, field: str
) -> tuple[PartitionedMesh, FloatArray]:
    """Return the mesh and the field of this rank; refuse an output that cannot be written."""
    from adaptsize.distributed.files import read_parts
    from adaptsize.ranks import as_communicator

    ranks = as_communicator(None) if console.world is None else console.world.comm
    ranks.agree(lambda: check_files([file], output, content))
    part = read_parts(file, ranks)
    mesh = part.mesh
    return part, ranks.agree(
        lambda: np.empty(0) if mesh is None else nodal_field(mesh, field).astype(np.float64)
    )


def limit_in_parts(console: Console, file: Path, output: Path, given: Given) -> None:
    """Limit the gradient of a nodal field of a distributed mesh."""
    from adaptsize import limit_gradient
    from adaptsize.distributed.files import write_parts

    _check_options(given, {"field", "g", "method", "mpi"})
    gradient, method = given["g"], given.get("method", "auto")
    with console.steps(3) as steps:
        steps.begin("reading")
        part, h0 = _read(console, file, output, "sizes", given["field"])
        steps.begin("limiting")
        h = limit_gradient(part, h0, gradient, method=method, progress=steps.report)
        steps.begin("writing")
        write_parts(output, part, fields={"h": h})
    own = part.is_owned
    lowered = part.ranks.allreduce(int(np.count_nonzero((h < h0)[own])), "sum")
    console.record(
        input=str(file), g=gradient, n_ranks=part.ranks.size, n_points=part.n_global_points,
        n_lowered=lowered,
    )  # fmt: skip
    console.print(f"{lowered} of {part.n_global_points} nodes lowered, on {part.ranks.size} ranks")
    _finish(console, part, output)


def remesh_in_parts(console: Console, file: Path, output: Path, given: Given) -> None:
    """Remesh a distributed mesh with the sizes in a nodal field, limited."""
    from adaptsize import limit_gradient
    from adaptsize.background import interpolate
    from adaptsize.distributed.files import write_parts
    from adaptsize.remeshing import remesh
    from adaptsize.remeshing.in_parts import interface_quality

    known = {"field", "g", "hmin", "hmax", "target", "backend", "mpi"}
    _check_options(given, known | _OF_MESHING)
    if "field" not in given:
        raise ValueError("--field is required for distributed meshes")
    gradient = given.get("g", GRADIENT_LIMIT)
    options = {name: given[name] for name in _OF_MESHING & given.keys()}
    low, high = as_limits(given.get("hmin"), given.get("hmax"))
    with console.steps(4) as steps:
        steps.begin("reading")
        part, bounds = _read(console, file, output, "mesh", given["field"])
        h0 = np.clip(bounds, low, high)
        steps.begin("limiting")
        h = limit_gradient(part, h0, gradient, progress=steps.report)
        steps.begin("meshing")
        made = remesh(part, h, progress=steps.report, **options)
        sizes = interpolate(part, h, made.points)
        quality = interface_quality(made, sizes)
        steps.begin("writing")
        write_parts(output, made, fields={"h": sizes})
    console.record(
        input=str(file), g=gradient, n_ranks=part.ranks.size,
        quality={
            "everywhere": vars(quality.everywhere), "at_interfaces": vars(quality.at_interfaces)
        },
    )  # fmt: skip
    console.print(quality)
    _finish(console, made, output)


def _finish(console: Console, part: PartitionedMesh, output: Path) -> None:
    """Print the warnings of all ranks, and what was written."""
    for texts in part.ranks.allgather(console.warnings):
        for text in texts:
            console.warn(text)
    n_points, n_cells = part.n_global_points, part.n_global_cells
    console.wrote(file=str(output))
    console.print(f"{output}: {n_points} points, {n_cells} cells")
