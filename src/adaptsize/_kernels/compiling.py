"""Compilation of kernels, and invalidation of the compilation cache.

numba makes two wrappers of a function, for calls from Python and through pointers.  Functions that
only other kernels call do without.

numba compiles a cached function again when its own file changes, but not when the file of a
function changes that it calls, whose code it contains.  So the cached functions of this package
get the state of all its files as their stamp.

numba raises whatever unpickling raises when a file of the cache is damaged, in each later run, and
would execute damaged code.  So files get a checksum, and damaged ones count as absent: the function
is compiled again, which replaces them.

numba imports all of its implementations of NumPy before it loads a compiled function, and parts of
SciPy with them.  Only the compiler needs them, which asks for them itself.  They took .3 s of each
process, more than numba without them.  So functions are loaded without.

numba compiles a function once for each number that a kernel passes as a literal, and again for
integers of another width.  Functions that kernels call get all of these as integers of 64 bits.
"""

import contextlib
import gc
from collections.abc import Callable, Iterator
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba import njit, types
from numba.core import event
from numba.core.runtime.nrt import rtsys

from adaptsize._kernels.linking import OF_KERNELS, OF_PARTS
from adaptsize._kernels.turns import one_after_the_other
from adaptsize._kernels.typing_memory import remembered_types, without_signals

_njit: Any = njit  # numba's annotations leave out its options about wrappers


class _WhileCompiling(event.Listener):
    """Pauses what only takes time while kernels of this package are compiled.

    That is Python's search for cyclic garbage: the compiler makes millions of objects, and hardly
    any garbage; searching it takes a tenth of the time.  And the signals of LLVM's lock, which each
    function under compilation hears, and repeated resolution of types, see `typing_memory`.  numba
    holds a lock meanwhile, so that two threads do not compile at the same time.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._paused = contextlib.ExitStack()

    def on_start(self, started: event.Event) -> None:
        if self._depth == 0 and _is_ours(started):
            self._paused.enter_context(_without_garbage_collection())
            self._paused.enter_context(without_signals())
            self._paused.enter_context(remembered_types())
        if self._depth > 0 or _is_ours(started):
            self._depth += 1

    def on_end(self, _ended: event.Event) -> None:
        self._depth = max(0, self._depth - 1)
        if self._depth == 0:
            self._paused.close()


@contextlib.contextmanager
def _without_garbage_collection() -> Iterator[None]:
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if not gc.get_freeze_count():  # otherwise a caller has frozen objects, and keeps them so
            gc.freeze()  # makes all new objects old ones, which are searched seldom
            gc.unfreeze()
        gc.enable()


def _is_ours(compiled: event.Event) -> bool:
    function = compiled.data["dispatcher"].py_func
    return str(function.__module__).startswith(__package__)


event.register("numba:compile", _WhileCompiling())


@cache
def _state_of(directory: Path) -> str:
    """Return a hash of all Python files of a directory as they are at the first call."""
    state = sha256()
    for file in sorted(directory.glob("*.py")):
        state.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return state.hexdigest()


def _refuse_damaged_files(index: Any) -> None:
    """Make numba's object for the files of one function treat damaged ones as absent."""
    used = ("_dump", "_load_index", "_load_data", "_data_path")
    if not all(hasattr(index, name) for name in used):  # not public either
        return
    dump, load_index, load_data = index._dump, index._load_index, index._load_data

    def dump_with_checksum(value: Any) -> bytes:
        data = dump(value)
        return bytes(data) + sha256(data).digest()  # unpickling ignores what follows

    def load_whole_index() -> Any:
        try:
            return load_index()
        except OSError:
            raise
        except Exception:  # unpickling of damaged data may raise anything
            return {}

    def load_whole_data(name: str) -> Any:
        content = Path(index._data_path(name)).read_bytes()
        if sha256(content[:-32]).digest() != content[-32:]:
            raise FileNotFoundError(f"{name} is damaged")  # numba handles this as absence
        return load_data(name)

    index._dump, index._load_index = dump_with_checksum, load_whole_index
    index._load_data = load_whole_data


def _load_without_compiler(files: Any) -> None:
    """Make numba's object for the cache of one function load it without what compiles it."""
    used = ("load_overload", "_load_overload", "_guard_against_spurious_io_errors")
    if not all(hasattr(files, name) for name in used):  # not public either
        return

    def load_overload(signature: Any, target: Any) -> Any:
        import numba.cpython.hashing  # noqa: F401  # defines symbols that compiled code may refer to

        rtsys.initialize(target)  # and those for counted references
        with files._guard_against_spurious_io_errors():
            return files._load_overload(signature, target)

    files.load_overload = load_overload


def _once_for_all_integers(dispatcher: Any) -> Any:
    """Make a function the same one for literals and for integers of 32 bits."""
    template = getattr(dispatcher, "get_call_template", None)
    if template is None:  # not public in numba; it compiles once more then
        return dispatcher

    def template_of_values(args: Any, kws: Any) -> Any:
        return template([_wide(one) for one in args], {name: _wide(kws[name]) for name in kws})

    dispatcher.get_call_template = template_of_values
    return dispatcher


def _wide(kind: Any) -> Any:
    """Return the type of an argument without its value, and 64 bits for signed integers."""
    kind = types.unliteral(kind)
    return types.int64 if kind in (types.int8, types.int16, types.int32) else kind


def _cached(**options: Any) -> Callable[[Any], Any]:
    """Return a decorator like numba's, with a cache that sees changes in all files beside."""
    common = {"cache": True, "nogil": True, "no_cfunc_wrapper": True}
    linking = OF_PARTS if "no_cpython_wrapper" in options else OF_KERNELS
    compiled = _njit(**{**common, **options, **linking})

    def decorate(function: Any) -> Any:
        dispatcher = _once_for_all_integers(compiled(function))
        # Not public in numba: if it is elsewhere in another version, its own stamp stays.
        files = getattr(dispatcher, "_cache", None)
        index = getattr(files, "_cache_file", None)
        if index is not None and hasattr(index, "_source_stamp"):
            beside = Path(function.__code__.co_filename).parent
            index._source_stamp = (index._source_stamp, _state_of(beside))
            _refuse_damaged_files(index)
            _load_without_compiler(files)
            one_after_the_other(dispatcher, files, index)
        return dispatcher

    return decorate


#: For functions called from Python.
kernel = _cached()

#: For functions called from kernels only; Python cannot call them.
inner = _cached(no_cpython_wrapper=True)

#: For kernels that allocate no arrays, and do not count references, and what they call.
lean_kernel = _cached(_nrt=False, error_model="numpy")
lean = _cached(_nrt=False, error_model="numpy", no_cpython_wrapper=True)

#: The same, for functions that take many arrays: a call would copy what describes each of them,
#: which took a third of the time of intersections.  LLVM inlines them into their callers; numba
#: (``inline="always"``) would find the types in each copy again.
inlined = _cached(_nrt=False, error_model="numpy", no_cpython_wrapper=True, forceinline=True)

_generated = _njit(
    nogil=True,
    _nrt=False,
    error_model="numpy",
    no_cfunc_wrapper=True,
    no_cpython_wrapper=True,
    **OF_PARTS,
)


def generated(function: Any) -> Any:
    """Decorate a function with others as free variables, which becomes part of cached kernels."""
    return _once_for_all_integers(_generated(function))
