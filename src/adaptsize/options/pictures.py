"""Options of pictures."""

import os
from typing import Annotated, Literal, TypedDict

from adaptsize.options.option import Option


class PictureOptions(TypedDict, total=False):
    """Picture.

    path
        File to write (.png, .jpg, .tif or .bmp), completely or not at all.
    clip
        Axis normal to the plane through the middle at which the mesh is cut.  The whole cells
        behind the plane are shown.  "auto" cuts tetrahedra and boxes in space, such that the
        section is long.  None shows the whole.
    width
        Width of the picture in pixels.  The height follows from the mesh.
    window
        Whether to show a window first, in which the mouse turns and enlarges what is drawn, and
        return the last view when it is closed.
    """

    path: Annotated[str | os.PathLike[str] | None, Option(type_text="str or path")]
    clip: Annotated[Literal["auto", "x", "y", "z"] | None, Option("auto")]
    width: Annotated[int, Option(1600, lower=64.0, upper=10_000.0)]
    window: Annotated[bool, Option(False)]


class ScaledPictureOptions(PictureOptions, total=False):
    """Picture with a colour bar.

    limits
        Lowest and highest value of the colour bar, for pictures to be compared; not for
        regions.
    """

    limits: Annotated[
        tuple[float, float] | None,
        Option(chosen="those of the values", type_text="tuple of float"),
    ]
