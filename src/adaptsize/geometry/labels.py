"""The labels of an image that are nearest at places."""

from typing import NamedTuple

from adaptsize.typing import FloatArray, IntArray


class Nearest(NamedTuple):
    """The two labels with the smallest fields at places."""

    first: IntArray
    """Numbers of labels; the first one is the label of the place."""
    second: IntArray
    least: FloatArray
    """The smallest field, in pixels; negative inside a label."""
    gap: FloatArray
    """The second smallest field less that: twice the distance of the interface, nearly."""
