"""``adaptsize adapt``: the next mesh of an adaptive loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize.cli.console import Console, with_console
from adaptsize.cli.files import check_files, nodal_field
from adaptsize.cli.options import Gradient, Input, MeshOutput, Nodes, Picture
from adaptsize.cli.output import draw, print_written, write_mesh

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from adaptsize.adaptation.result import AdaptResult
    from adaptsize.background import SimplexMesh

#: The sizes that a mesh was made for.  Those of the next mesh replace them.
_SIZES = "h"


@with_console
def adapt(
    console: Console,
    file: Input,
    output: MeshOutput,
    field: Annotated[
        str,
        typer.Option(
            "--field",
            metavar="NAME",
            help="Cell field with the error of each cell; or nodal field with the solution, whose "
            "error is then estimated by its recovered gradient (Zienkiewicz-Zhu).",
        ),
    ],
    elements: Annotated[
        float | None,
        typer.Option(
            "--elements",
            metavar="NUMBER",
            help="Number of elements of the next mesh, within 15 %.  With --tolerance at most "
            "this number.  [default: none]",
        ),
    ] = None,
    nodes: Nodes = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="NUMBER",
            help="Target for the total error, the root of the sum of the squares.  [default: none]",
        ),
    ] = None,
    order: Annotated[
        float,
        typer.Option(metavar="NUMBER", help="The error is proportional to this power of the size."),
    ] = 1.0,
    gradient: Gradient = GRADIENT_LIMIT,
    hmin: Annotated[
        float | None, typer.Option(metavar="LENGTH", help="Smallest size.  [default: none]")
    ] = None,
    hmax: Annotated[
        float | None, typer.Option(metavar="LENGTH", help="Largest size.  [default: none]")
    ] = None,
    plot: Picture = None,
) -> None:
    """Make the next mesh of an adaptive loop.

    Its sizes come from an error indicator or a solution.  Fields and tags of the file are
    transferred.  A mesh that already has the sizes is written unchanged.
    """
    from adaptsize.adaptation import adapt as next_mesh
    from adaptsize.io import read

    check_files([file], {"--output": (output, "mesh"), "--plot": (plot, "picture")})
    if elements is None and nodes is None and tolerance is None:
        raise ValueError("adapt needs --elements, --nodes or --tolerance, got none of them")
    with console.steps(4) as steps:
        steps.begin("reading")
        mesh = read(file)
        indicator = indicator_of(mesh, field)
        steps.begin("adapting")
        result = next_mesh(
            mesh,
            indicator,
            order=order,
            target_elements=elements,
            target_nodes=nodes,
            tolerance=tolerance,
            g=gradient,
            hmin=hmin,
            hmax=hmax,
            fields={name: v for name, v in mesh.point_data.items() if name != _SIZES},
            cell_fields={name: v for name, v in mesh.cell_data.items() if name != field},
            conservative=mesh.cell_dim == mesh.dim,
            progress=steps.report,
        )
        steps.begin("writing")
        new = result.mesh
        new = new.with_data(
            point_data={**result.fields, _SIZES: result.size(new.points)},
            cell_data=result.cell_fields,
        )
        written = write_mesh(output, new)
        draw(console, plot, new)
    console.record(input=str(file), **as_dict(result))
    console.print(f"{result.reason}\n{result.report}")
    for held in written:
        print_written(console, held)


def indicator_of(mesh: SimplexMesh, name: str) -> npt.NDArray[np.float64]:
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
            "share_in_band": report.after.share_in_band,
            "angle_min": report.after.angle_min,
            "radius_ratio_min": report.after.radius_ratio_min,
            "boundary_distance": report.boundary_distance,
        },
        "lost_tags": report.lost_tags,
    }
