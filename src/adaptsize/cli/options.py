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
        "-K",
        "--elements-per-radian",
        help="Elements per radian of curved boundaries.  0 disables.",
    ),
]
Across = Annotated[
    float | None,
    typer.Option("--elements-across", help="Elements across narrow regions.  0 disables."),
]
Gradient = Annotated[float, typer.Option("-g", "--gradient", help="Gradient limit.")]
Smallest = Annotated[float | None, typer.Option("--hmin", help="Smallest size.")]
Largest = Annotated[float | None, typer.Option("--hmax", help="Largest size.")]
Crease = Annotated[
    float,
    typer.Option(
        "--crease-angle",
        help="Angle in degrees above which an edge is a feature edge, not curvature.",
    ),
]
Sources = Annotated[
    list[str] | None,
    typer.Option(
        "--source",
        help="point:x,y,z=h, ball:x,y,z,r=h, box:x0,y0,z0,x1,y1,z1=h, boundary[:tag]=h or "
        "region:tag=h.  In the plane, omit the z coordinates.  May be repeated.",
    ),
]
Field = Annotated[str | None, typer.Option("--field", help="Nodal field to use as upper bounds.")]
Picture = Annotated[Path | None, typer.Option("--plot", help="Also draw the result (.png).")]
Label = Annotated[
    list[int] | None,
    typer.Option("--label", help="Label of the objects.  May be repeated.  All but 0 by default."),
]
Threshold = Annotated[
    float | None,
    typer.Option("--threshold", help="Pixels with larger values belong to the objects."),
]
Spacing = Annotated[
    str | None,
    typer.Option(
        "--spacing", help="Pixel size: 0.5 or 0.5,0.5,1.25.  By default that of the file."
    ),
]
Smoothing = Annotated[
    float | None,
    typer.Option(
        "--smoothing", help="Width of the low-pass filter of the mask, in pixels.  2 by default."
    ),
]
#: Equal to `adaptsize.domain_size.request.MAX_ELEMENTS`, which is slow to import.
MAX_ELEMENTS = 300_000.0
MaxElements = Annotated[
    float,
    typer.Option(
        "--max-elements",
        help="Parameters that are not given are relaxed until the mesh has about this many "
        "elements.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
