"""Files are written completely or not at all; devices and pipes are written into, never read."""

import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Callable
from html import unescape
from pathlib import Path
from urllib.parse import unquote

from adaptsize._messages import Message, message_of
from adaptsize.errors import MeshFileError, OptionError

#: Longest text of an error after the path.  Names of fields come from files and may be long.
_LONGEST = 600


def check_readable(path: Path) -> None:
    """Refuse what is not a file with content.  A pipe would block, and a device never end."""
    try:
        if path.is_dir():
            raise MeshFileError("is a directory")
        if is_special(path):
            raise MeshFileError("is a device or a pipe, where a file is required")
        with path.open("rb") as opened:
            empty = not opened.read(1)
    except OSError as error:
        raise MeshFileError(f"{error.strerror or error}") from error
    if empty:
        raise MeshFileError("is empty")


#: Lines that may have names of other files, by suffix, and the words in them that may be names.
_WITH_LETTERS = re.compile(r"^.*[A-DF-Za-df-z/\\].*$", re.MULTILINE)
_NAMING = {
    **dict.fromkeys((".pvtu", ".pvtp", ".vtm", ".gltf", ".xdmf", ".xmf", ".nhdr"), _WITH_LETTERS),
    ".inp": re.compile(r"^\s*\*\s*INCLUDE.*$", re.MULTILINE | re.IGNORECASE),
}
_WORDS = re.compile(r"[^\"'<>\r\n:=,]+")


def files_named_in(path: Path) -> list[Path]:
    """Return the existing files that a file names.

    Raises
    ------
    MeshFileError
        If one is outside of its folder, or a device or pipe.  The message does not have the path.
    """
    lines = _NAMING.get(path.suffix.lower())
    if lines is None:
        return []
    text = unquote(unescape(path.read_text(encoding="utf-8", errors="replace")))
    words = {
        word.strip()
        for line in lines.findall(text)
        for word in _WORDS.findall(line)
        if len(word) < 300
    }
    files = {word: os.path.join(path.parent, word) for word in words}  # Path raises for long names
    return [
        neighbour(path, word)
        for word, file in files.items()
        if os.path.exists(file) and not os.path.isdir(file)
    ]


def neighbour(path: Path, name: str) -> Path:
    """Return the file that a file names; refuse one outside of its folder, and what is no file."""
    file, folder = path.parent / name, path.parent.resolve()
    if folder not in file.resolve().parents:
        raise MeshFileError(f"names the file {name!r}, which is outside of its folder")
    if is_special(file):
        raise MeshFileError(f"names {name!r}, which is a device or a pipe")
    return file


def about_file(path: str | os.PathLike[str], error: BaseException) -> MeshFileError | OptionError:
    """Return an error of one line with the path and the problem; of options, one about these."""
    if isinstance(error, OptionError):
        return OptionError(Message("{}: {}", path, message_of(error)), error.options)
    if isinstance(error, MemoryError):
        text = "needs more memory than there is"
    elif isinstance(error, OSError):
        text = error.strerror or str(error)
    else:
        text = " ".join(str(error).split()) or type(error).__name__
    if len(text) > _LONGEST:
        text = f"{text[: _LONGEST - 3]}..."
    return MeshFileError(f"{path}: {text}")


def write_whole(target: Path, write_to: Callable[[Path], None]) -> None:
    """Write under a temporary name in the same directory and rename.  Raises OSError."""
    if is_special(target):  # it must not be replaced
        with tempfile.TemporaryDirectory(prefix="adaptsize-") as folder:
            whole = Path(folder, target.name)
            write_to(whole)
            with whole.open("rb") as content, target.open("wb", buffering=0) as device:
                shutil.copyfileobj(content, device)
        return
    temporary = temporary_for(target)
    try:
        write_to(temporary)
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def temporary_for(target: Path) -> Path:
    """Return a new name in the same directory; refuse a target that cannot be a file."""
    if target.is_dir():
        raise MeshFileError("is a directory")
    if not target.parent.is_dir():
        raise MeshFileError(f"there is no directory {target.parent}")
    # Not tempfile: its files are private to the user, and the suffix must be kept.
    return target.with_name(f".adaptsize-{secrets.token_hex(8)}{target.suffix}")


def is_special(path: Path) -> bool:
    """Whether a path exists and is neither a file nor a directory: a device, pipe or socket."""
    return path.exists() and not path.is_file() and not path.is_dir()
