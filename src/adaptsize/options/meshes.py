"""Options of the functions that make meshes."""

from typing import Annotated, Literal, TypedDict

import numpy as np

from adaptsize._defaults import GRADIENT_LIMIT, TOLERANCE
from adaptsize.options.option import Option
from adaptsize.options.sizes import BudgetOptions, ImageSizeOptions, LargestOptions, SizeOptions


class GeneratorOptions(TypedDict, total=False):
    """Mesh generator.

    backend
        Mesh generator: auto, mmg or tetwild.  "auto" is Mmg or fTetWild.
    timeout
        Time limit of all mesh generators together, after which the best mesh so far is returned.
    """

    backend: Annotated[str, Option("auto")]
    timeout: Annotated[
        float | None,
        Option(
            chosen="a limit for each generator in proportion to the number of elements",
            unit="seconds",
            above=True,
        ),
    ]


class MeshOptions(GeneratorOptions, total=False):
    """Mesh generator.

    target
        Made of a surface: auto, tetrahedra or triangles.  "auto" fills it with tetrahedra, unless
        it lies in a plane.
    strict
        Whether the mesh must meet all requirements of `check_mesh`.  If it does not, smaller
        tolerances and other generators are tried.
    """

    target: Annotated[Literal["auto", "tetrahedra", "triangles"], Option("auto")]
    strict: Annotated[bool, Option(False)]


class PartsOptions(TypedDict, total=False):
    """Meshes in parts.

    how
        Remesh each part in rounds by Mmg (parts), or all on rank 0 (gather).
    rounds
        Number of rounds of "parts".
    """

    how: Annotated[Literal["parts", "gather"], Option("parts")]
    rounds: Annotated[int, Option(2, lower=1.0, upper=20.0)]


class RemeshOptions(MeshOptions, LargestOptions, PartsOptions, total=False):
    """Remeshing.

    g
        Gradient with which nodal sizes on a surface grow into the volume.  A SizeFunction on a
        surface uses its own g, if it has one.
    hmax
        Upper limit of the sizes, including those that grow into a volume.
    tolerance
        Allowed distance of the new boundary from the old one, over the diagonal.
    """

    g: Annotated[float, Option(GRADIENT_LIMIT, is_slope=True, of_sizes=True, short="-g")]
    hmax: Annotated[float, Option(float("inf"), unit="length", above=True, inf=True)]
    tolerance: Annotated[float, Option(TOLERANCE, above=True, upper=1.0)]


class DistanceOptions(LargestOptions, total=False):
    """Mesh from a distance.

    clip
        Whether the domain may extend beyond the box.  It is then cut off there.
    seed
        Seed of the random initial points.  The same seed gives the same mesh on the same
        machine.
    max_iter
        Maximum number of smoothing steps.
    """

    clip: Annotated[bool, Option(False)]
    seed: Annotated[
        int | np.random.Generator, Option(2004, type_text="int or numpy.random.Generator")
    ]
    max_iter: Annotated[int, Option(150, lower=1.0)]


class ImageMeshOptions(ImageSizeOptions, total=False):
    """Mesh of an image.

    seed
        Seed of the random initial points.
    """

    seed: Annotated[int, Option(2004)]


class DetailOptions(TypedDict, total=False):
    """Mesh generator.

    least_detail
        First remove smaller bores, bosses and text.
        See `adaptsize.remeshing.remove_details`.
    """

    least_detail: Annotated[float | None, Option(unit="length", above=True)]


class RemeshToElementsOptions(SizeOptions, MeshOptions, DetailOptions, total=False):
    """Mesh with a number of elements."""


class FamilyOptions(SizeOptions, BudgetOptions, MeshOptions, total=False):
    """Mesh family.

    levels
        Number of meshes.
    ratio
        Size of each mesh over that of the next one.
    """

    levels: Annotated[int, Option(4, lower=2.0, upper=20.0)]
    ratio: Annotated[float, Option(2.0**0.5, lower=1.05, upper=10.0)]
