"""Processes with the same cache compile a kernel one after the other, so that one compiles it.

The others wait, and load it.  This also keeps numba's index of a kernel right: two processes that
save the same kernel for different types at the same time may use one file name for both.
"""

import contextlib
import errno
import os
import sys
import time
import zlib
from collections.abc import Iterator
from typing import Any

#: Seconds between looks for whether another process is done, and seconds to wait in all.
_PAUSE = 0.02
_PATIENCE = 120.0
#: Errors of a lock that another process has; systems differ.
_ANOTHER_HAS_IT = (errno.EAGAIN, errno.EACCES)

#: By folder, a file whose bytes stand for kernels.  A process gives up its locks when it closes it.
_files: dict[str, int] = {}
#: The locks of this process: descriptor and byte, by the kernel's index file.
_held: dict[str, tuple[int, int]] = {}


def take(index: str) -> None:
    """Wait until no other process compiles the kernel with this index file, and reserve it.

    Nothing is done on systems, and in file systems, without locks.
    """
    if sys.platform == "win32" or index in _held:
        return
    import fcntl

    byte = zlib.crc32(os.path.basename(index).encode())
    with contextlib.suppress(OSError):
        file = _file_in(os.path.dirname(index))
        until = time.monotonic() + _PATIENCE
        while time.monotonic() < until:
            try:
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
            except OSError as error:
                if error.errno not in _ANOTHER_HAS_IT:  # locks that this file system lacks
                    raise
                time.sleep(_PAUSE)
            else:
                _held[index] = file, byte
                return


def give(index: str) -> None:
    """Let other processes compile or load the kernel."""
    if sys.platform == "win32" or index not in _held:
        return
    import fcntl

    file, byte = _held.pop(index)
    with contextlib.suppress(OSError):
        fcntl.lockf(file, fcntl.LOCK_UN, 1, byte)


@contextlib.contextmanager
def given_on_failure(index: str) -> Iterator[None]:
    """Give the kernel up if compiling it fails."""
    try:
        yield
    except BaseException:
        give(index)
        raise


def _file_in(folder: str) -> int:
    if folder not in _files:
        os.makedirs(folder, exist_ok=True)
        _files[folder] = os.open(
            os.path.join(folder, "compiling.lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666
        )
    return _files[folder]


def _forget() -> None:
    """Begin without locks in a process made by fork: locks stay with the one that made it."""
    _held.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def one_after_the_other(dispatcher: Any, files: Any, index: Any) -> None:
    """Make numba's object for one kernel wait for other processes that compile it."""
    used = ("load_overload", "save_overload")
    if not all(hasattr(files, name) for name in used) or not hasattr(index, "_index_path"):
        return  # not public in numba
    load, save, compiler = files.load_overload, files.save_overload, dispatcher._compiler
    path, compile_it = index._index_path, compiler.compile

    def load_or_take(signature: Any, target: Any) -> Any:
        loaded = load(signature, target)
        if loaded is None:
            take(path)
            with given_on_failure(path):
                loaded = load(signature, target)  # another process may have compiled it
            if loaded is not None:
                give(path)
        return loaded

    def compile_or_give(*arguments: Any) -> Any:
        with given_on_failure(path):
            return compile_it(*arguments)

    def save_and_give(signature: Any, data: Any) -> None:
        try:
            # Numba 0.60 has sometimes no code to save; the kernel is compiled, and runs.
            with contextlib.suppress(RuntimeError):
                save(signature, data)
        finally:
            give(path)

    files.load_overload, files.save_overload = load_or_take, save_and_give
    compiler.compile = compile_or_give
