"""What numba finds out many times during compilation, found out once.

It looks up the implementation of each operation, such as the sum of two float64, in all that it
knows of the operator, again for each operation of each function.
"""

import contextlib
import inspect
from collections.abc import Iterator
from typing import Any

from llvmlite.binding import ffi
from numba.core.targetconfig import ConfigStack
from numba.core.types.functions import BaseFunction

_Function: Any = BaseFunction
_resolve: Any = BaseFunction.get_call_type
#: For each function type: itself, and by the compiler's options, context and types of arguments
#: the signature and what its implementation is registered for.
_memory: dict[int, tuple[Any, dict[Any, tuple[Any, Any]]]] = {}
#: By its identity, an object that holds options and is not changed any more, and its text.
_texts: dict[int, tuple[Any, str]] = {}


def _options() -> str:
    """Return the options of the function under compilation as a text."""
    flags = ConfigStack.top_or_none()
    if id(flags) not in _texts:
        _texts[id(flags)] = flags, repr(flags)
    return _texts[id(flags)][1]


def _get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """Return the signature of a call as numba does, and remember it."""
    known = _memory.setdefault(id(self), (self, {}))[1]
    key = (_options(), id(context), tuple(args), tuple(dict(kws).items()))
    if key not in known:
        signature = _resolve(self, context, args, kws)
        if signature is None:
            return None
        known[key] = signature, self._impl_keys[signature.args]
    signature, implementation = known[key]
    self._impl_keys[signature.args] = implementation  # it may be that of other options
    return signature


_is_known = [*inspect.signature(_resolve).parameters] == ["self", "context", "args", "kws"]


@contextlib.contextmanager
def remembered_types() -> Iterator[None]:
    """Remember implementations of operations while kernels are compiled.

    A version of numba that looks them up otherwise does so as often as it does.
    """
    if not _is_known:
        yield
        return
    _Function.get_call_type = _get_call_type
    try:
        yield
    finally:
        _Function.get_call_type = _resolve
        _texts.clear()


@contextlib.contextmanager
def without_signals() -> Iterator[None]:
    """Do not tell listeners when LLVM is called."""
    listeners: list[Any] = getattr(ffi.lib._lock, "_cblist", [])
    before = listeners[:]
    listeners.clear()
    try:
        yield
    finally:
        listeners[:] = before
