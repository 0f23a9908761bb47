"""Damaged images are refused with one clear line."""

import struct
import zlib

import numpy as np
import pytest

from adaptsize import read_image
from adaptsize.errors import MeshFileError


def png(width, height):
    def chunk(name, data):
        check = struct.pack(">I", zlib.crc32(name + data))
        return struct.pack(">I", len(data)) + name + data + check

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    pixels = zlib.compress(bytes(100))
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )


def test_a_picture_of_too_many_pixels_is_refused(tmp_path):
    pytest.importorskip("PIL")
    (tmp_path / "a.png").write_bytes(png(20_000, 20_000))
    with pytest.raises(MeshFileError, match=r"a\.png: .*400000000 pixels"):
        read_image(tmp_path / "a.png")


def test_damaged_archives_of_arrays_are_refused(tmp_path):
    file = tmp_path / "a.npz"
    np.savez(file, labels=np.eye(4, dtype=int))
    content = file.read_bytes()
    for n in range(0, len(content), 5):
        file.write_bytes(content[:n])
        with pytest.raises(MeshFileError, match=r"a\.npz: "):
            read_image(file)
    flipped = bytearray(content)
    flipped[200] ^= 255  # inside the numbers: their checksum is wrong
    file.write_bytes(flipped)
    with pytest.raises(MeshFileError, match=r"a\.npz: .*CRC"):
        read_image(file)
