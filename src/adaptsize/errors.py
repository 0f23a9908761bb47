"""Every exception and warning class of adaptsize.

Each is derived from a built-in class, so that ``except ValueError`` and the like
work without importing this module.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from adaptsize._messages import Message

__all__ = [
    "BackendError",
    "BackendTimeoutError",
    "BackendUnavailableError",
    "BoundaryWarning",
    "ConnectionWarning",
    "ConvergenceWarning",
    "InputWarning",
    "MeshFileError",
    "MeshingError",
    "OpenSurfaceWarning",
    "OptionError",
    "OutsideError",
    "ResolutionWarning",
    "TooManyElementsError",
]


class OptionError(ValueError):
    """An option has a bad value, or does not go with others or with the input.

    ``options`` are the names of these options.
    """

    def __init__(self, message: str, options: Sequence[str] = ()):
        super().__init__(message)
        if isinstance(message, Message) and not options:
            options = message.options
        self.options = tuple(options)


class MeshFileError(ValueError):
    """A file cannot be read as a mesh, or a mesh cannot be written as requested."""


class OutsideError(ValueError):
    """A point lies outside the background of a size function with ``outside="error"``."""


class TooManyElementsError(ValueError):
    """More elements are needed than ``max_elements`` or another option allows.

    ``elements`` is the expected number, None where it is not known.  ``enough`` maps options to the
    smallest values, in two digits, with which few enough are needed: ``{"tolerance": 0.004}``, say.
    Each of them is enough alone; it is empty if none is known.
    """

    def __init__(
        self,
        message: str,
        elements: float | None = None,
        enough: Mapping[str, float] = MappingProxyType({}),
    ):
        super().__init__(message)
        self.elements = elements
        self.enough = dict(enough)


class BackendError(RuntimeError):
    """A mesh generator failed, crashed or returned an unusable mesh."""


class BackendTimeoutError(BackendError):
    """A mesh generator did not finish within its time limit and was stopped."""


class MeshingError(BackendError):
    """No mesh met the requirements of ``remesh(..., strict=True)``.

    ``check`` is the `MeshCheck` of the last mesh, or None if there was none.
    """

    def __init__(self, message: str, check: object = None):
        super().__init__(message)
        self.check = check


class BackendUnavailableError(ImportError):
    """The requested mesh generator is not installed.  The message says how to install it."""


class ConvergenceWarning(UserWarning):
    """A method stopped at ``max_iter``, or at another limit, before it converged."""


class InputWarning(UserWarning):
    """The input was repaired, used in part only, or looks wrong.  The message says what and where.

    Points of a mesh were merged or cells dropped, part of an image was left out, a source lies
    outside the domain and acts on the closest part of it, or a value looks like one in another
    unit, such as radians instead of degrees.
    """


class ConnectionWarning(InputWarning):
    """Cells side by side are not connected, and stay so.  The message says where."""


class OpenSurfaceWarning(UserWarning):
    """A surface is open, or has bodies that overlap or nearly touch: its volume must be guessed.

    The message says where.
    """


class ResolutionWarning(UserWarning):
    """A mesh misses part of its domain, has badly shaped cells, or needs too many of them.

    The message gives the details.
    """


class BoundaryWarning(ResolutionWarning):
    """The boundary of a new mesh is much farther from the given one than the tolerance."""
