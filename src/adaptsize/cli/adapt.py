"""``adaptsize adapt``: the next mesh of an adaptive loop."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from adaptsize.cli.console import Console
from adaptsize.cli.files import check_files, draw, nodal_field, print_written, write_mesh
from adaptsize.cli.options import FIELD, PLOT, Given, Input, MeshOutput, command
from adaptsize.options import AdaptOptions, SizeOptions, TransferOptions, options_of
from adaptsize.typing import FloatArray, NodalMethod

if TYPE_CHECKING:
    from adaptsize.adaptation.report import AdaptResult
    from adaptsize.background import SimplexMesh

#: The sizes that a mesh was made for.  Those of the next mesh replace them.
_SIZES = "h"


@command(
    replace(
        FIELD,
        default=...,
        group="Adaptation",
        text="Cell field with the error of each cell; or nodal field with the solution, whose "
        "error is then estimated by its recovered gradient (Zienkiewicz-Zhu).",
    ),
    AdaptOptions,
    options_of(SizeOptions)["g"],
    replace(options_of(TransferOptions)["method"], type=NodalMethod),
    PLOT,
    without="conservative corner_angle anisotropic norm max_aspect how rounds",
)
def adapt(console: Console, file: Input, output: MeshOutput, given: Given) -> None:
    """Make the next mesh of an adaptive loop.

    Its sizes come from an error indicator or a solution.  Fields and tags of the file are
    transferred.  A mesh that already has the sizes is written unchanged.
    """
    from adaptsize.adaptation import adapt as next_mesh
    from adaptsize.io import read

    field, plot = given.pop("field"), given.pop("plot", None)
    check_files([file], output, "mesh", plot=plot)
    if not given.keys() & {"elements", "nodes", "tolerance"}:
        raise ValueError("adapt needs --elements, --nodes or --tolerance, got none of them")
    with console.steps(4) as steps:
        steps.begin("reading")
        mesh = read(file)
        indicator = indicator_of(mesh, field)
        steps.begin("adapting")
        result = next_mesh(
            mesh,
            indicator,
            fields={name: v for name, v in mesh.point_data.items() if name != _SIZES},
            cell_fields={name: v for name, v in mesh.cell_data.items() if name != field},
            conservative=mesh.cell_dim == mesh.dim,
            progress=steps.report,
            **given,
        )
        steps.begin("writing")
        new = result.mesh
        new = new.with_data(
            point_data={**result.fields, _SIZES: result.size(new.points)},
            cell_data=result.cell_fields,
        )
        written = write_mesh(output, new)
        draw(console, "size", plot, new)
    console.record(input=str(file), **as_dict(result))
    console.print(f"{result.reason}\n{result.report}")
    print_written(console, *written)


def indicator_of(mesh: SimplexMesh, name: str) -> FloatArray:
    """Return the error of each cell: a cell field, or estimated from a nodal field.

    Raises
    ------
    ValueError
        If there is no field of that name, or one of each kind.
    """
    from adaptsize.sizes import zz_indicator

    at_nodes, in_cells = name in mesh.point_data, name in mesh.cell_data
    if at_nodes and in_cells:
        raise ValueError(f"{name!r} is a nodal field and a cell field of the mesh: rename one")
    if in_cells:
        return mesh.cell_data[name].reshape(mesh.n_cells, -1).squeeze(axis=1)
    if at_nodes:
        return zz_indicator(mesh, nodal_field(mesh, name))
    listed = ", ".join([*mesh.cell_data, *mesh.point_data]) or "none"
    raise ValueError(f"the mesh has no field {name!r}; it has: {listed}")


def as_dict(result: AdaptResult) -> dict[str, Any]:
    """Return the decision and the numbers of the report, for the JSON object."""
    report = result.report
    new: Any = report.after  # Conformity: the mesh is whole
    return {
        "remeshed": result.remeshed,
        "converged": result.converged,
        "reason": result.reason,
        "error": report.error,
        "budget_met": report.budget_met,
        "n_elements": report.predicted_elements,
        "mesh": {
            "n_points": report.n_points_after,
            "n_cells": report.n_cells_after,
            "share_in_band": new.share_in_band,
            "angle_min": new.angle_min,
            "radius_ratio_min": new.radius_ratio_min,
            "boundary_distance": report.boundary_distance,
        },
        "lost_tags": report.lost_tags,
    }
