"""The options of each method of `limit_gradient`; other options are refused, not ignored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypeAlias

Method: TypeAlias = Literal[
    "auto",
    "exact",
    "fast-marching",
    "positive-coefficient",
    "hamilton-jacobi",
    "edge-based",
]

#: The options of each method.
#: Every method accepts a `LimitingInfo` as ``initial``; only those listed here accept an array.
_OPTIONS: dict[str, frozenset[str]] = {
    "exact": frozenset({"face_sources", "threads", "point_sources", "periodic"}),
    "fast-marching": frozenset({"order", "periodic"}),
    "positive-coefficient": frozenset({"initial", "tol", "max_iter", "floor"}),
    "hamilton-jacobi": frozenset({"order", "initial", "tol", "max_iter"}),
    "edge-based": frozenset(),
}

# Options that no method has on meshes.
_ON_GRIDS = ("order",)

# Methods that ``method="auto"`` may choose.
_AUTOMATIC = ("exact", "fast-marching")


def refuse_idle(method: str, available: tuple[str, ...], given: Mapping[str, bool]) -> None:
    """Raise a ValueError if an option was given that the method does not use.

    Parameters
    ----------
    method : str
        ``"auto"`` uses all options of the methods that it may choose.
    available : tuple of str
        The methods for this kind of background.
    given : dict of bool
        Whether each option differs from its default.

    Raises
    ------
    ValueError
        The message names the first such option and the methods that use it.
    """
    on_grid = "hamilton-jacobi" in available
    taken = [m for m in _AUTOMATIC if m in available] if method == "auto" else [method]
    for name, is_given in given.items():
        on_this = on_grid or name not in _ON_GRIDS
        if not is_given or (on_this and any(name in _OPTIONS[m] for m in taken)):
            continue
        known = [m for m in available if name in _OPTIONS[m]] if on_this else []
        where = "" if known else f" on a {'SimplexMesh' if on_grid else 'CartesianGrid'}"
        listed = " or ".join(repr(m) for m in known or _OPTIONS if name in _OPTIONS[m])
        raise ValueError(f"{name} is for method={listed}{where}, got method={method!r}")
