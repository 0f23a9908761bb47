"""Linking of kernels: the functions that a kernel calls are optimized once, as parts of it.

numba optimizes each function with all that it calls, and generates machine code for it.  So a
function at the bottom of ten calls is optimized ten times, and only the machine code of the first
is used.  Functions that only kernels call are kept here as they are, until a kernel is complete.
"""

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.environment import lookup_environment

#: What is used of numba beside its documentation.  In a version without it, numba links functions.
_USED = ("_get_module_for_linking", "_optimize_final_module", "_finalize_final_module")
_Library: Any = JITCodeLibrary
_Compiler: Any = Compiler


class _WithoutEnvironment:
    """The code generator of numba for functions without machine code."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, environment: Any) -> None:
        """Leave the environment to the kernels that contain the function."""


class _Part(_Library):  # type: ignore[misc]
    """A function that becomes part of kernels."""

    @property
    def codegen(self) -> Any:
        """Return the code generator."""
        return _WithoutEnvironment(self._codegen)

    def finalize(self) -> None:
        """Accept no more code."""
        self._raise_if_finalized()
        self._finalized = True

    def get_pointer_to_function(self, _name: str) -> int:
        """Return that there is no machine code."""
        self._ensure_finalized()
        return 0

    def own_module(self) -> Any:
        """Return the function alone, to link it."""
        return super()._get_module_for_linking()

    def _get_module_for_linking(self) -> Any:
        """Return the function with all that it calls, for a kernel that numba links."""
        module = self.own_module().clone()
        for library in _all_called(self):
            module.link_in(_module_of(library), preserve=True)
        return module


class _Kernel(_Library):  # type: ignore[misc]
    """A kernel with all that it calls."""

    def finalize(self) -> None:
        """Link, optimize, and generate machine code."""
        self._codegen._check_llvm_bugs()
        self._raise_if_finalized()
        for library in _all_called(self):
            if hasattr(library, "_reload_init"):  # of newer versions of numba
                self._reload_init.update(library._reload_init)
            self._final_module.link_in(_module_of(library), preserve=True)
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()
        for variable in self._final_module.global_variables:
            environment = lookup_environment(variable.name)
            if environment is not None and not variable.is_declaration:
                self._codegen.set_env(variable.name, environment)


def _module_of(library: Any) -> Any:
    if isinstance(library, _Part):
        return library.own_module()
    return library._get_module_for_linking()


def _all_called(library: Any) -> list[Any]:
    """Return the libraries that one links directly, or through parts, callers first.

    LLVM links only those functions of a module that are called in what is linked before.
    """
    seen: set[int] = set()
    callees_first: list[Any] = []

    def visit(caller: Any) -> None:
        for called in caller._linking_libraries:
            if id(called) not in seen:
                seen.add(id(called))
                if isinstance(called, _Part):
                    visit(called)
                callees_first.append(called)

    visit(library)
    return callees_first[::-1]


class _IntoLibrary(_Compiler):  # type: ignore[misc]
    """numba's compiler with one of the libraries above."""

    library: Any

    def define_pipelines(self) -> Any:
        """Return numba's own."""
        state = self.state
        if state.library is None:
            state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
        return super().define_pipelines()


class _IntoKernel(_IntoLibrary):
    library = _Kernel


class _IntoPart(_IntoLibrary):
    library = _Part


_is_known = all(hasattr(JITCodeLibrary, name) for name in _USED)
#: Options of numba for kernels, and for functions that only kernels call.
OF_KERNELS: dict[str, Any] = {"pipeline_class": _IntoKernel} if _is_known else {}
OF_PARTS: dict[str, Any] = {"pipeline_class": _IntoPart, "cache": False} if _is_known else {}
