"""Arguments and options that several commands share.

Lengths are in the unit of the coordinates in the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Input = Annotated[Path, typer.Argument(metavar="FILE", help="Mesh: STL, VTU, .msh, .mesh, ...")]
MeshOutput = Annotated[
    Path,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help="Mesh to write.  The suffix selects the format: .vtu, .vtk, .xdmf, .msh, .mesh (with "
        "a .sol); .ply, .stl, .obj and .off hold triangles only.",
    ),
]
SizesOutput = Annotated[
    Path,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help="File to write.  The suffix selects the format: .vtu, .vtk, .xdmf, .msh, .ply; .pos "
        "(for Gmsh), .sol (for Mmg), .jig.msh (for JIGSAW); .vti for images.",
    ),
]
ImageFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="Image: PNG, TIFF, NIfTI, NRRD, .npy, .npz")
]
PerRadian = Annotated[
    float | None,
    typer.Option(
        "-K",
        "--elements-per-radian",
        metavar="NUMBER",
        help="Elements per radian of curved boundaries.  0 disables.  "
        "[default: 4; with --field: 0]",
    ),
]
Across = Annotated[
    float | None,
    typer.Option(
        "--elements-across",
        metavar="NUMBER",
        help="Elements across narrow regions.  0 disables.  [default: 2; with --field: 0]",
    ),
]
Between = Annotated[
    float | None,
    typer.Option(
        "--elements-between",
        metavar="NUMBER",
        help="Elements between features that are close and do not meet.  0 disables.  "
        "[default: 1, on rough surfaces 0; with --field: 0]",
    ),
]
ImagePerRadian = Annotated[
    float | None,
    typer.Option(
        "-K",
        "--elements-per-radian",
        metavar="NUMBER",
        help="Elements per radian of curved boundaries.  0 disables.  [default: 4]",
    ),
]
ImageAcross = Annotated[
    float | None,
    typer.Option(
        "--elements-across",
        metavar="NUMBER",
        help="Elements across narrow regions.  0 disables.  [default: 2]",
    ),
]
Gradient = Annotated[
    float,
    typer.Option(
        "-g", "--gradient", metavar="NUMBER", help="Gradient limit: growth of the size per length."
    ),
]
Smallest = Annotated[
    float | None,
    typer.Option(
        "--hmin",
        metavar="LENGTH",
        help="Smallest size, in the unit of the coordinates.  [default: 1/1000 of the diameter]",
    ),
]
ImageSmallest = Annotated[
    float | None,
    typer.Option(
        "--hmin",
        metavar="LENGTH",
        help="Smallest size, in the unit of the coordinates.  [default: 1/1000 of the diameter; of "
        "an image 1/1000 of its diagonal, at least 2 pixels]",
    ),
]
Largest = Annotated[
    float | None,
    typer.Option(
        "--hmax",
        metavar="LENGTH",
        help="Largest size, in the unit of the coordinates.  [default: 1/20 of the diameter, of "
        "an image of its diagonal]",
    ),
]
Crease = Annotated[
    float,
    typer.Option(
        "--crease-angle",
        metavar="DEGREES",
        help="Angle above which an edge is a feature edge, not curvature.",
    ),
]
Sources = Annotated[
    list[str] | None,
    typer.Option(
        "--source",
        metavar="SOURCE",
        help="point:x,y,z=h, curve:x0,y0,z0:x1,y1,z1:...=h, curve:FILE=h (segments, or a text with "
        "one point per line), ball:x,y,z,r=h, box:x0,y0,z0,x1,y1,z1=h, boundary[:tag]=h or "
        "region:tag=h; lengths in the unit of the coordinates.  In the plane, omit the z "
        "coordinates.  May be repeated.  [default: none]",
    ),
]
Field = Annotated[
    str | None,
    typer.Option(
        "--field",
        metavar="NAME",
        help="Nodal field of the file to use as upper bounds.  [default: none]",
    ),
]
MetricField = Annotated[
    str | None,
    typer.Option(
        "--metric",
        metavar="NAME",
        help="Sizes that depend on the direction: a nodal field of matrices, or a .sol or .solb "
        "file.  [default: none]",
    ),
]
Picture = Annotated[
    Path | None,
    typer.Option(
        "--plot",
        metavar="FILE",
        help="Also draw the result (.png).  [default: none]",
    ),
]
Report = Annotated[
    Path | None,
    typer.Option(
        "--report",
        metavar="FILE",
        help="Also write a page for the browser, with the mesh in 3-D (.html).  [default: none]",
    ),
]
Label = Annotated[
    list[int] | None,
    typer.Option(
        "--label",
        metavar="NUMBER",
        help="Label of the objects in an image.  May be repeated.  [default: all but 0]",
    ),
]
Threshold = Annotated[
    float | None,
    typer.Option(
        "--threshold",
        metavar="NUMBER",
        help="Pixels with larger values belong to the objects, instead of labels.  [default: none]",
    ),
]
Spacing = Annotated[
    str | None,
    typer.Option(
        "--spacing",
        metavar="LENGTHS",
        help="Size of a pixel, in the unit of the mesh: 0.5 or 0.5,0.5,1.25.  "
        "[default: that of the file]",
    ),
]
Smoothing = Annotated[
    float | None,
    typer.Option(
        "--smoothing",
        metavar="PIXELS",
        help="Width of the low-pass filter of the mask.  [default: 2 pixels]",
    ),
]
MaxElements = Annotated[
    float | None,
    typer.Option(
        "--max-elements",
        metavar="NUMBER",
        help="Parameters that are not given are relaxed until the mesh has about this many "
        "elements.  [default: 300000; with --elements: none]",
    ),
]
ImageMaxElements = Annotated[
    float,
    typer.Option(
        "--max-elements",
        metavar="NUMBER",
        show_default=False,  # typer prints 300000.0
        help="Parameters that are not given are relaxed until the mesh has about this many "
        "elements.  [default: 300000]",
    ),
]
Mpi = Annotated[
    bool,
    typer.Option(
        "--mpi",
        help="Run on all ranks of MPI.  Needed only if the launcher is not recognized.",
    ),
]
Elements = Annotated[
    float | None,
    typer.Option(
        "--elements",
        metavar="NUMBER",
        help="Number of elements of the mesh, within 15 %: parameters that are not given are "
        "relaxed or tightened, and up to three meshes are made.  [default: none]",
    ),
]
Nodes = Annotated[
    float | None,
    typer.Option(
        "--nodes",
        metavar="NUMBER",
        help="Number of nodes of the mesh, instead of --elements.  [default: none]",
    ),
]
PredictedElements = Annotated[
    float | None,
    typer.Option(
        "--elements",
        metavar="NUMBER",
        help="Predicted number of elements of a mesh: parameters that are not given are relaxed "
        "or tightened.  [default: none]",
    ),
]
