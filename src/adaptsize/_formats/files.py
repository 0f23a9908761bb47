"""Files on disk: checks before reading, and writing of whole files only."""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from adaptsize.errors import MeshFileError


def write_whole(target: Path, write_to: Callable[[Path], None]) -> None:
    """Write under a temporary name in the same directory and rename.  Raises OSError."""
    if target.is_dir():
        raise MeshFileError("is a directory")
    if is_special(target):
        _write_into(target, write_to)
        return
    if not target.parent.is_dir():
        raise MeshFileError(f"there is no directory {target.parent}")
    # Not tempfile: its files are private to the user, and the suffix must be kept.
    temporary = target.with_name(f".adaptsize-{secrets.token_hex(8)}{target.suffix}")
    try:
        write_to(temporary)
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def is_special(path: Path) -> bool:
    """Whether a path exists and is neither a file nor a directory: a device, pipe or socket."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _write_into(special: Path, write_to: Callable[[Path], None]) -> None:
    """Write to a temporary file and copy its content, because a device must not be replaced."""
    with tempfile.TemporaryDirectory(prefix="adaptsize-") as folder:
        whole = Path(folder, special.name)
        write_to(whole)
        with whole.open("rb") as content, special.open("wb", buffering=0) as device:
            shutil.copyfileobj(content, device)


def check_readable(file: Path) -> None:
    """Raise a MeshFileError if a file is missing, empty, a directory or may not be read."""
    if file.is_dir():
        raise MeshFileError(f"{file}: is a directory")
    try:
        with file.open("rb") as opened:
            empty = not opened.read(1)
    except OSError as error:
        raise MeshFileError(f"{file}: {error.strerror or error}") from error
    if empty:
        raise MeshFileError(f"{file}: is empty")
