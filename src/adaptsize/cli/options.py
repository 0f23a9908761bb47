"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Input = Annotated[Path, typer.Argument(metavar="FILE", help="Mesh: STL, VTU, .msh, .mesh, ...")]
Output = Annotated[Path, typer.Option("-o", "--output", help="File to write.")]
ImageFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="Image: PNG, TIFF, NIfTI, NRRD, .npy, .npz")
]
PerRadian = Annotated[
    float | None,
    typer.Option(
        "-K", "--elements-per-radian", help="Elements per radian of curved boundaries; 0: none."
    ),
]
Across = Annotated[
    float | None,
    typer.Option("--elements-across", help="Elements across narrow parts; 0: none."),
]
Gradient = Annotated[float, typer.Option("-g", "--gradient", help="Gradient limit of the size.")]
Smallest = Annotated[float | None, typer.Option("--hmin", help="Smallest size.")]
Largest = Annotated[float | None, typer.Option("--hmax", help="Largest size.")]
Crease = Annotated[
    float, typer.Option("--crease-angle", help="Sharper edges are no curvature, degrees.")
]
Sources = Annotated[
    list[str] | None,
    typer.Option(
        "--source",
        help="point:x,y,z=h, ball:x,y,z,r=h, box:x0,y0,z0,x1,y1,z1=h, boundary[:tag]=h or "
        "region:tag=h; without z in the plane; may be repeated.",
    ),
]
Field = Annotated[str | None, typer.Option("--field", help="Nodal field of the file to use.")]
Picture = Annotated[Path | None, typer.Option("--plot", help="Also draw the result (.png).")]
Label = Annotated[
    list[int] | None,
    typer.Option("--label", help="Label of the objects; may be repeated.  All but 0 otherwise."),
]
Threshold = Annotated[
    float | None, typer.Option("--threshold", help="Objects are where values are larger.")
]
Spacing = Annotated[
    str | None,
    typer.Option("--spacing", help="Pixel size, if not that of the file: 0.5 or 0.5,0.5,1.25."),
]
Smoothing = Annotated[
    float | None,
    typer.Option("--smoothing", help="Low-pass filter of the mask, in pixels, 2 otherwise."),
]
#: As `adaptsize.domain_size.request.MAX_ELEMENTS`, without importing what that needs.
MAX_ELEMENTS = 300_000.0
MaxElements = Annotated[
    float,
    typer.Option(
        "--max-elements", help="Relax sizes that are not given until the mesh has about so many."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
