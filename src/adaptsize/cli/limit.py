"""``adaptsize limit``: sizes whose gradient is limited."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from adaptsize.cli.console import Console
from adaptsize.cli.files import (
    check_cells,
    check_files,
    draw,
    holds_more_than_sizes,
    nodal_field,
    print_written,
    write_sizes,
)
from adaptsize.cli.metric import limit_with_metric
from adaptsize.cli.options import FIELD, METRIC, PLOT, Given, Input, SizesOutput, command, own
from adaptsize.options import SizeOptions, options_of

if TYPE_CHECKING:
    import numpy.typing as npt

    from adaptsize.limiting.info import LimitingInfo


@command(
    replace(options_of(SizeOptions)["g"], default=...),
    replace(FIELD, text="Nodal field with the upper bounds."),
    METRIC,
    own(
        "Sizes", "method", str, default="auto",
        text="auto, or a method of limit_gradient, such as fast-marching.",
    ),
    PLOT,
)  # fmt: skip
def limit(console: Console, file: Input, output: SizesOutput, given: Given) -> None:
    """Limit the gradient of a nodal field.  The result is written as the field h, or metric.

    Of the exact method, the field source holds the node from which each size originates.
    """
    if ("field" in given) == ("metric" in given):
        raise ValueError("give either --field or --metric")
    if "metric" in given:
        limit_with_metric(console, file, output, given)
    else:
        _limit_sizes(console, file, output, given)


def _limit_sizes(console: Console, file: Path, output: Path, given: Given) -> None:
    """Limit a field of sizes on one process."""
    from adaptsize.io import read
    from adaptsize.limiting import limit_gradient

    g, plot = given["g"], given.get("plot")
    check_files([file], output, "sizes", plot=plot)
    with console.steps(3) as steps:
        steps.begin("reading")
        mesh = read(file)
        check_cells(output, mesh)
        h0 = nodal_field(mesh, given["field"])
        steps.begin("limiting")
        method = given.get("method", "auto")
        h, found = limit_gradient.with_info(mesh, h0, g, method=method, progress=steps.report)
        steps.begin("writing")
        fields: dict[str, npt.ArrayLike] = {"h": h}
        if found.sources is not None and holds_more_than_sizes(output):
            fields["source"] = found.sources.roots()
        written = write_sizes(output, mesh, fields)
        draw(console, "size", plot, mesh, h)
    console.record(input=str(file), method=found.method, g=g, n_points=mesh.n_points)
    _print_limited(console, found, mesh.n_points)
    print_written(console, written)


def _print_limited(console: Console, found: LimitingInfo, n_points: int) -> None:
    """Print how far sizes were limited, and record it."""
    quantiles = found.cell_gradient_quantiles
    console.record(
        n_lowered=found.n_changed,
        largest_edge_slope=found.largest_edge_slope,
        cell_gradient_quantiles=quantiles,
    )
    levels = ", ".join(f"{share:g}: {q:.3f}" for share, q in quantiles.items())
    console.print(f"{found.method}: {found.n_changed} of {n_points} nodes lowered")
    console.print(f"largest slope along an edge over g: {found.largest_edge_slope:.6f}")
    console.print(f"gradient in the cells over g, quantiles: {levels}")
