"""Pickles and copies of immutable dataclasses, and what is kept with them."""

from collections.abc import Callable, Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


class ReadOnlyState:
    """Base of frozen dataclasses whose arrays stay read-only after pickling and copying.

    A pickle holds only the fields.  Derived data are computed again on first use.
    """

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, with read-only mappings (which cannot be pickled) as dictionaries."""
        state = {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]
        return {n: dict(v) if isinstance(v, Mapping) else v for n, v in state.items()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Set the fields and make them read-only again, which pickles and deep copies lose."""
        for name, value in state.items():
            object.__setattr__(self, name, _read_only(value))


def _read_only(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value = value.view()
        value.flags.writeable = False
    elif isinstance(value, dict):
        return MappingProxyType({key: _read_only(item) for key, item in value.items()})
    return value


def once(owner: object, name: str, compute: Callable[[], T]) -> T:
    """Return a value that is computed on first use and kept with an immutable object.

    It is derived from the object and the name, as a cached property is.
    """
    kept: dict[str, Any] = vars(owner)
    if name not in kept:
        kept[name] = compute()
    value: T = kept[name]
    return value
