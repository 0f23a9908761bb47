"""How kernels are compiled that only other kernels call.

numba makes two wrappers of a function, for calls from Python and through pointers, which are
compiled and optimised with all that the function calls: a quarter of the time of compiling.
"""

from typing import Any

from numba import njit

_njit: Any = njit  # numba's annotations leave out its options about wrappers

#: For functions called from Python.
kernel = _njit(cache=True, nogil=True, no_cfunc_wrapper=True)

#: For functions called from kernels only; Python cannot call them.
inner = _njit(cache=True, nogil=True, no_cfunc_wrapper=True, no_cpython_wrapper=True)

#: For small parts of one kernel that has no time for a call with many arrays.
part = _njit(inline="always", no_cfunc_wrapper=True, no_cpython_wrapper=True)
