"""Registry of mesh generators: which exist, and which one is selected."""

from __future__ import annotations

from collections.abc import Mapping

from adaptsize._checks import one_of, refusal
from adaptsize.errors import BackendUnavailableError
from adaptsize.remeshing.mmg import MmgBackend
from adaptsize.remeshing.protocol import Backend, Task
from adaptsize.remeshing.tetwild import TetWildBackend

#: In order of preference for ``backend="auto"``.
_BACKENDS: dict[str, Backend] = {}


def register_backend(backend: Backend) -> None:
    """Register a mesh generator for ``remesh(backend=backend.name)``.

    With ``backend="auto"`` it is used only where the others cannot make a mesh.

    Parameters
    ----------
    backend : Backend
        Replaces a generator of the same name.
    """
    _BACKENDS[backend.name] = backend


for _backend in (MmgBackend(), TetWildBackend()):
    register_backend(_backend)


def available_backends() -> Mapping[str, Backend]:
    """Return the known mesh generators, with their capabilities and whether they are installed.

    Returns
    -------
    mapping of str to Backend

    Examples
    --------
    >>> backends = available_backends()
    >>> sorted(backends)
    ['mmg', 'tetwild']
    >>> backends["tetwild"].installed
    True
    """
    return dict(_BACKENDS)


def able_backends(task: Task, *, keep_facets: bool, metric: bool = False) -> list[Backend]:
    """Return the mesh generators that support a task, in order of preference."""
    return [
        backend
        for backend in _BACKENDS.values()
        if task in backend.tasks
        and backend.keeps_required_facets >= keep_facets
        and backend.follows_metrics >= metric
    ]


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
    if name == "auto":
        able = able_backends(task, keep_facets=keep_facets, metric=metric)
        backend = next((b for b in able if b.installed), able[0])
    else:
        backend = _BACKENDS[name]
        if task not in backend.tasks:
            raise refusal("backend", f"{name!r} cannot make this mesh (task: {task})")
        if keep_facets and not backend.keeps_required_facets:
            raise refusal("backend", f"{name!r} cannot keep required_facets as they are")
        if metric and not backend.follows_metrics:
            raise refusal("backend", f"{name!r} cannot follow a Metric; use 'mmg'")
    if not backend.installed:
        raise BackendUnavailableError(
            f"this mesh (task: {task}) needs {backend.name}, which is not installed; "
            f"install it with: {backend.install}"
        )
    return backend
