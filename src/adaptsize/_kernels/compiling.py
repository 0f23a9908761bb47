"""Compilation of kernels, and invalidation of the compilation cache.

numba makes two wrappers of a function, for calls from Python and through pointers, which are
compiled and optimised with all that the function calls: a quarter of the time of compiling.
Kernels that only other kernels call do without.  numba also optimises each function and translates
it to machine code before it becomes part of its callers, where that is done again.  Functions that
only kernels call do without this, too, which saves an eighth of the time.

All that is done here is for the time of the first call.  Results do not depend on it.

numba compiles a cached function again when its own file changes, but not when the file of a
function changes that it calls, whose code it contains.  So the cached functions of this package
get the state of all its files as their stamp.

numba raises whatever unpickling raises when a file of the cache is damaged, in each later run, and
would execute damaged code.  So files get a checksum, and damaged ones count as absent: the function
is compiled again, which replaces them.
"""

import gc
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba import njit
from numba import version_info as numba_version
from numba.core import event
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager

_njit: Any = njit  # numba's annotations leave out its options about wrappers


class _NoEnvironment:
    """Takes the place of numba's code generator, of which nothing else is used after compiling."""

    def set_env(self, name: str, environment: Any) -> None:
        """Ignore the environment; only wrappers use it."""


class _PartOfCallers(JITCodeLibrary):
    """The code of a function, linked but neither optimised nor translated to machine code."""

    codegen = _NoEnvironment()

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0  # there is none


class _InnerCompiler(CompilerBase):
    """numba's compiler for functions that only kernels call."""

    def define_pipelines(self) -> list[Any]:
        state = self.state
        state.library = _PartOfCallers(state.targetctx.codegen(), state.func_id.func_qualname)
        return [DefaultPassBuilder.define_nopython_pipeline(state)]


#: Passes for what lean kernels do not have: closures, containers, contexts, array expressions.
_UNUSED_PASSES = {
    "DumpParforDiagnostics",
    "FindLiterallyCalls",
    "InlineClosureLikes",
    "InlineInlinables",
    "InlineOverloads",
    "LiteralPropagationSubPipelinePass",
    "LiteralUnroll",
    "MakeFunctionToJitFunction",
    "NopythonRewrites",
    "RewriteDynamicRaises",
    "WithLifting",
}


def _few_of(full: Any) -> Any:
    """Return the passes that lean kernels need."""
    few = PassManager("lean")
    used = dict(pair for pair in full.passes if pair[0].__name__ not in _UNUSED_PASSES)
    for step, description in used.items():  # repeated ones at their first place
        few.add_pass(step, description)
    few.finalize()
    return few


class _OptimisedOnce(JITCodeLibrary):
    """The code of a lean kernel; numba optimises twice, to remove the counting of references."""

    def _optimize_final_module(self) -> None:
        try:
            manager, builder = self._codegen._module_pass_manager()
        except (AttributeError, TypeError):  # not public: other versions have it otherwise
            super()._optimize_final_module()
        else:
            manager.run(self._final_module, builder)


class _LeanCompiler(Compiler):
    """numba's compiler for lean kernels."""

    def define_pipelines(self) -> list[Any]:
        state = self.state
        state.library = _OptimisedOnce(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return [_few_of(full) for full in super().define_pipelines()]


class _LeanInnerCompiler(_InnerCompiler):
    """numba's compiler for what lean kernels call."""

    def define_pipelines(self) -> list[Any]:
        return [_few_of(full) for full in super().define_pipelines()]


class _WithoutGarbageCollection(event.Listener):
    """Pauses Python's search for cyclic garbage while kernels of this package are compiled.

    The compiler makes millions of objects, and hardly any garbage; searching it takes a tenth of
    the time.  numba holds a lock meanwhile, so that two threads do not compile at the same time.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._paused = False

    def on_start(self, started: event.Event) -> None:
        if self._depth == 0 and _is_ours(started):
            self._paused = gc.isenabled()
            gc.disable()
        if self._depth > 0 or _is_ours(started):
            self._depth += 1

    def on_end(self, _ended: event.Event) -> None:
        self._depth = max(0, self._depth - 1)
        if self._depth == 0 and self._paused:
            self._paused = False
            gc.enable()


def _is_ours(compiled: event.Event) -> bool:
    function = compiled.data["dispatcher"].py_func
    return str(function.__module__).startswith(__package__)


event.register("numba:compile", _WithoutGarbageCollection())


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


def _cached(**options: Any) -> Callable[[Any], Any]:
    """Return a decorator like numba's, with a cache that sees changes in all files beside."""
    compiled = _njit(**{"cache": True, "nogil": True, "no_cfunc_wrapper": True, **options})

    def decorate(function: Any) -> Any:
        dispatcher = compiled(function)
        # Not public in numba: if it is elsewhere in another version, its own stamp stays.
        index = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
        if index is not None and hasattr(index, "_source_stamp"):
            beside = Path(function.__code__.co_filename).parent
            index._source_stamp = (index._source_stamp, _state_of(beside))
            _refuse_damaged_files(index)
        return dispatcher

    return decorate


# What follows is not public in numba: without it, and with versions later than the last one that
# was tried, functions are compiled as usual, which takes longer.
_LAST_TRIED = (0, 68)
_PRIVATE = ["_optimize_functions", "_optimize_final_module", "_finalize_final_module"]
_PRIVATE += ["_finalize_dynamic_globals", "_ensure_finalized"]
_INNER: dict[str, Any] = {"no_cpython_wrapper": True}
_LEAN: dict[str, Any] = {"_nrt": False, "error_model": "numpy"}
_LEAN_INNER = {**_LEAN, **_INNER}
_is_known = numba_version[:2] <= _LAST_TRIED
if _is_known and all(hasattr(JITCodeLibrary, name) for name in _PRIVATE):
    _LEAN["pipeline_class"] = _LeanCompiler
    _INNER.update(cache=False, pipeline_class=_InnerCompiler)
    _LEAN_INNER.update(cache=False, pipeline_class=_LeanInnerCompiler)

#: For functions called from Python.
kernel = _cached()

#: For functions called from kernels only; Python cannot call them.
inner = _cached(**_INNER)

#: For kernels that allocate no arrays, and do not count references, and what they call.
lean_kernel = _cached(**_LEAN)
lean = _cached(**_LEAN_INNER)

#: For small parts of one kernel that has no time for a call with many arrays.
part = _njit(inline="always", no_cfunc_wrapper=True, no_cpython_wrapper=True)
