"""The options of ``adaptsize remesh``."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any

import typer

from adaptsize._defaults import CREASE_ANGLE
from adaptsize.cli.options import (
    Across,
    Between,
    Crease,
    Elements,
    Field,
    Input,
    Largest,
    MaxElements,
    MeshOutput,
    MetricField,
    Mpi,
    Nodes,
    PerRadian,
    Picture,
    Report,
    Smallest,
    Sources,
)

_BACKENDS = ("auto", "tetwild", "mmg", "gmsh")
_TARGETS = ("auto", "tetrahedra", "triangles")


@dataclass(frozen=True)
class Options:
    """The arguments and options of the command, as given."""

    file: Input
    output: MeshOutput
    elements_per_radian: PerRadian = None
    elements_across: Across = None
    elements_between: Between = None
    gradient: Annotated[
        float | None,
        typer.Option(
            "-g",
            "--gradient",
            metavar="NUMBER",
            help="Gradient limit: growth of the size per length.  [default: 0.25; 1 with --metric]",
        ),
    ] = None
    hmin: Smallest = None
    hmax: Largest = None
    crease_angle: Crease = CREASE_ANGLE
    source: Sources = None
    field: Field = None
    metric: MetricField = None
    target: Annotated[
        str,
        typer.Option(
            metavar="KIND",
            autocompletion=lambda: list(_TARGETS),
            help="Cells to make from a surface: auto, tetrahedra or triangles.",
        ),
    ] = "auto"
    backend: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            autocompletion=lambda: list(_BACKENDS),
            help="Mesh generator: auto, tetwild, mmg or gmsh.",
        ),
    ] = "auto"
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="NUMBER",
            help="Distance of the new boundary from the old one, over the diagonal.  "
            "[default: 0.001, more if --max-elements or --elements requires it]",
        ),
    ] = None
    close: Annotated[
        bool,
        typer.Option("--close", help="Close the holes of a surface first, by nearly plane caps."),
    ] = False
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="Write only a mesh that meets the demands of check; refuse open surfaces, and "
            "bodies that overlap or are closer than the tolerance.",
        ),
    ] = False
    max_elements: MaxElements = None
    elements: Elements = None
    nodes: Nodes = None
    timeout: Annotated[
        float, typer.Option(metavar="SECONDS", help="Time limit of the mesh generators.")
    ] = 3600.0
    plot: Picture = None
    report: Report = None
    mpi: Mpi = False
    gather: Annotated[
        bool, typer.Option("--gather", help="Under MPI, mesh on one rank instead of in parts.")
    ] = False

    def besides(self, accepted: str) -> dict[str, bool]:
        """Return the options that are given and not among these names."""
        return {
            f"--{option.name.replace('_', '-')}": True
            for option in fields(self)
            if option.name not in accepted.split()
            and getattr(self, option.name) not in (option.default, [])
        }

    def named(self, names: str) -> dict[str, Any]:
        """Return the values of some options by their names."""
        return {name: getattr(self, name) for name in names.split()}

    def given(self, names: str) -> dict[str, Any]:
        """Return those of some options that are not None."""
        return {name: value for name, value in self.named(names).items() if value is not None}
