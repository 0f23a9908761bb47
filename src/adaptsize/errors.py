"""Every exception and warning class of adaptsize.

Each is also a built-in one, so that ``except ValueError`` and the like work
without importing this module.
"""


class MeshFileError(ValueError):
    """A file cannot be read as a mesh, or a mesh cannot be written as asked."""


class OutsideError(ValueError):
    """A point lies outside the background and ``outside="error"`` was asked for."""


class TooManyElementsError(ValueError):
    """The sizes ask for more elements than ``max_elements`` allows."""


class BackendError(RuntimeError):
    """A mesh generator failed, crashed or returned an unusable mesh."""


class BackendTimeoutError(BackendError):
    """A mesh generator did not finish within its time limit and was stopped."""


class BackendUnavailableError(ImportError):
    """The mesh generator that is wanted is not installed; the message says how to get it."""


class PlotError(RuntimeError):
    """A picture cannot be drawn on this machine."""


class ConvergenceWarning(UserWarning):
    """A method stopped at ``max_iter``, or at a limit of its own, before it had converged."""


class MeshRepairWarning(UserWarning):
    """An input mesh was mended (points merged, cells dropped); the message counts what."""


class ImageWarning(UserWarning):
    """Part of an image was left out or taken otherwise; the message says what."""


class ResolutionWarning(UserWarning):
    """A mesh misses some of its domain, or has cells of poor shape; the message says what."""


class OutsideWarning(UserWarning):
    """A source lies outside the domain and acts on the closest part of it only."""
