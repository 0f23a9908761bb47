"""``adaptsize family``: self-similar meshes for a convergence study, and the observed order."""

from __future__ import annotations

from pathlib import Path

from adaptsize.cli.console import Console
from adaptsize.cli.files import check_files, print_written, read_mesh, write_mesh
from adaptsize.cli.options import SOURCE, Given, Input, MeshOutput, command, own
from adaptsize.cli.sources import parse_source
from adaptsize.options import FamilyOptions, checked

_VALUES = own(
    "Mesh family", "values", str,
    "Numbers computed on meshes that this command has written, such as 1.31,1.22,1.19, the "
    "coarsest first.  Prints their order of convergence; makes no meshes.",
)  # fmt: skip


@command(FamilyOptions, SOURCE, _VALUES)
def family(console: Console, file: Input, output: MeshOutput, given: Given) -> None:
    """Make self-similar meshes for a convergence study: NAME-1.vtu is the coarsest.

    Options of the sizes are for the coarsest mesh.  From one mesh to the next, all bounds on the
    size and the gradient limit are divided by the ratio.
    """
    from adaptsize.domain_size.family import Convergence, mean_cell_size, mesh_family

    values = given.pop("values", None)
    if values is not None:
        numbers = _numbers(values)
        found = [mean_cell_size(read_mesh(path)) for path in _paths(output, len(numbers))]
        result = Convergence.of(found, numbers)
        console.record(mean_sizes=found, values=numbers, **vars(result))
        console.print(result)
        return
    paths = _paths(output, checked(FamilyOptions, given)["levels"])
    for path in paths:
        check_files([file], path, "mesh")
    given["sources"] = [parse_source(text) for text in given.pop("source", ())]
    with console.steps(3) as steps:
        steps.begin("reading")
        mesh = read_mesh(file)
        steps.begin("meshing")
        made = mesh_family(mesh, **given, progress=steps.report)
        steps.begin("writing")
        written = []
        for path, new, size in zip(paths, made.meshes, made.sizes, strict=True):
            written += write_mesh(path, new.with_data(point_data={"h": size(new.points)}))
    sizes = made.mean_sizes.tolist()
    console.record(input=str(file), mean_sizes=sizes, ratios=made.ratios.tolist())
    console.print("mean sizes  " + ", ".join(f"{h:.5g}" for h in sizes))
    console.print("ratios      " + ", ".join(f"{ratio:.4g}" for ratio in made.ratios))
    print_written(console, *written)


def _paths(output: Path, levels: int) -> list[Path]:
    """Return the files of the meshes, the coarsest first."""
    names = [f"{output.stem}-{level}{output.suffix}" for level in range(1, levels + 1)]
    return [output.with_name(name) for name in names]


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError as error:
        raise ValueError(
            f"--values must be numbers such as 1.31,1.22,1.19, got {text!r}"
        ) from error
