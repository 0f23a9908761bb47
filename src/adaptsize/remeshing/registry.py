"""Registry of mesh generators: which exist, which are installed, which one is selected."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import NamedTuple

from adaptsize._checks import one_of
from adaptsize.errors import BackendUnavailableError
from adaptsize.remeshing.gmsh import GmshBackend
from adaptsize.remeshing.mmg import MmgBackend
from adaptsize.remeshing.protocol import Backend, Task
from adaptsize.remeshing.tetwild import TetWildBackend

_BACKENDS: dict[str, Backend] = {}

#: Order of preference for ``backend="auto"``, without Gmsh (GPL, and no geometric tolerance).
_PREFERENCE: tuple[str, ...] = ("mmg", "tetwild")


class BackendInfo(NamedTuple):
    """Capabilities of one mesh generator."""

    installed: bool
    tasks: frozenset[Task]
    keeps_required_facets: bool
    install: str
    """The command that installs it."""
    follows_metrics: bool = False
    """Whether sizes may depend on the direction."""


def register_backend(backend: Backend) -> None:
    """Register a mesh generator for ``remesh(backend=backend.name)``.

    Parameters
    ----------
    backend : Backend
        Replaces a generator of the same name.
    """
    _BACKENDS[backend.name] = backend


for _backend in (TetWildBackend(), MmgBackend(), GmshBackend()):
    register_backend(_backend)


def available_backends() -> Mapping[str, BackendInfo]:
    """Return the capabilities of each known mesh generator, and whether it is installed.

    Returns
    -------
    mapping of str to BackendInfo

    Examples
    --------
    >>> backends = available_backends()
    >>> sorted(backends)
    ['gmsh', 'mmg', 'tetwild']
    >>> backends["tetwild"].installed
    True
    """
    return {
        name: BackendInfo(
            _is_installed(b), b.tasks, b.keeps_required_facets, b.install, b.follows_metrics
        )
        for name, b in _BACKENDS.items()
    }


def choose_backend(name: str, task: Task, *, keep_facets: bool, metric: bool = False) -> Backend:
    """Return the adapter for ``task``.

    Raises
    ------
    ValueError
        If there is no adapter of that name, or it does not support the task.
    BackendUnavailableError
        If it is not installed.
    """
    one_of("backend", name, ("auto", *_BACKENDS))
    if name != "auto":
        backend = _BACKENDS[name]
        if task not in backend.tasks:
            raise ValueError(f"backend {name!r} cannot make this mesh (task: {task})")
        if keep_facets and not backend.keeps_required_facets:
            raise ValueError(f"backend {name!r} cannot keep required_facets as they are")
        if metric and not backend.follows_metrics:
            raise ValueError(f"backend {name!r} cannot follow a Metric; use 'mmg'")
        return _installed_or_raise(backend, task)
    able = [
        b
        for b in (_BACKENDS[n] for n in _PREFERENCE if n in _BACKENDS)
        if task in b.tasks
        and (b.keeps_required_facets or not keep_facets)
        and (b.follows_metrics or not metric)
    ]
    return next((b for b in able if _is_installed(b)), None) or _installed_or_raise(able[0], task)


def check_installed(name: str) -> None:
    """Raise what `choose_backend` would raise, whatever the task, for a name.

    Raises
    ------
    ValueError
        If there is no adapter of that name.
    BackendUnavailableError
        If it is not installed.
    """
    one_of("backend", name, ("auto", *_BACKENDS))
    if name != "auto" and not _is_installed(_BACKENDS[name]):
        raise BackendUnavailableError(
            f"backend {name!r} is not installed; install it with: {_BACKENDS[name].install}"
        )


def is_usable(name: str) -> bool:
    """Whether the adapter of that name is known and its generator installed."""
    return name in _BACKENDS and _is_installed(_BACKENDS[name])


def backend_named(name: str) -> Backend:
    """Return the adapter of that name."""
    return _BACKENDS[name]


def _is_installed(backend: Backend) -> bool:
    return find_spec(backend.package) is not None


def _installed_or_raise(backend: Backend, task: Task) -> Backend:
    if not _is_installed(backend):
        raise BackendUnavailableError(
            f"this mesh (task: {task}) needs {backend.name}, which is not installed; "
            f"install it with: {backend.install}"
        )
    return backend
