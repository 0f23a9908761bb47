"""Surfaces of CAD files, triangulated by Gmsh, with the faces and edges of the model as tags."""

from __future__ import annotations

import os
import time
from importlib.util import find_spec
from pathlib import Path

from adaptsize._calls import recorded
from adaptsize._checks import as_number, as_path
from adaptsize._progress import Stage, reporting
from adaptsize.background import SimplexMesh
from adaptsize.errors import BackendUnavailableError, MeshFileError
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.typing import ProgressCallback

#: Suffixes of the files that OpenCASCADE reads.
SUFFIXES = (".step", ".stp", ".brep")


def is_cad_file(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is one for `read_cad`, by its name."""
    return Path(path).suffix.lower() in SUFFIXES


@recorded("read_cad", reads=True)
def read_cad(
    path: str | os.PathLike[str],
    *,
    elements_per_circle: float = 48.0,
    largest: float | None = None,
    timeout: float = 600.0,
    progress: ProgressCallback | bool | None = None,
) -> SimplexMesh:
    """Return the surface of a CAD model as triangles.

    Faces of the model become regions of the surface (``cell_tags``), edges become tagged segments
    (``tagged_facets``).  So `RegionSource` sets the size on a face,
    and `BoundarySource` along an edge.  `remesh` makes tetrahedra whose boundary facets carry the
    tags of the faces.

    Parameters
    ----------
    path : str or path
        STEP or BREP.
    elements_per_circle : float
        Triangles around a full circle, 6 or more.  The surface is off the model by about
        5 / n^2 radii.
    largest : float, optional
        Largest edge length, in the unit of the file; by default 1/10 of the diagonal.
    timeout : float
        Time limit in seconds.
    progress : callable, bool or None
        As for `adaptsize.remesh`.

    Returns
    -------
    SimplexMesh
        Triangles in space.

    Raises
    ------
    ValueError
        If an argument is invalid.
    MeshFileError
        If the file does not exist or holds no faces.
    BackendUnavailableError
        If Gmsh is not installed.
    BackendError
        If Gmsh cannot read the file, with its message.

    Notes
    -----
    Tags are the numbers that Gmsh gives to faces and edges, in the order of the file.  Names of
    faces in STEP files are not read, because Gmsh leaves them out.

    Gmsh (GPL) is installed with ``pip install "adaptsize[gmsh]"``.  It runs in a child process.

    Examples
    --------
    >>> part = read_cad("part.step")  # doctest: +SKIP
    >>> size = size_function(part, sources=RegionSource(3, 0.5))  # doctest: +SKIP
    """
    file = as_path("path", path)
    if not is_cad_file(file):
        raise ValueError(f"path must end in {', '.join(SUFFIXES)}, got {os.fspath(path)!r}")
    count = as_number("elements_per_circle", elements_per_circle, lower=6.0)
    limit = 0.0 if largest is None else as_number("largest", largest, lower=0.0, strict=True)
    seconds = as_number("timeout", timeout, lower=0.0, strict=True)
    if not file.is_file():
        raise MeshFileError(f"{file} does not exist")
    if find_spec("gmsh") is None:
        raise BackendUnavailableError(
            "CAD files need gmsh, which is not installed; install it with: "
            'pip install "adaptsize[gmsh]"'
        )
    with reporting(progress) as report:
        run = IsolatedRunner("gmsh", seconds, time.monotonic() + seconds, report)
        made = run(
            "adaptsize.remeshing.gmsh:triangulate",
            Stage("triangulating the CAD model", "Gmsh"),
            {},
            {"path": str(file.resolve()), "count": count, "largest": limit},
        )
    if len(made["cells"]) == 0:
        raise MeshFileError(f"{file} holds no faces")
    return SimplexMesh(
        made["points"],
        made["cells"],
        cell_tags=made["cell_tags"],
        tagged_facets=made["segments"],
        facet_tags=made["segment_tags"],
    )
