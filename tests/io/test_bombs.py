"""Small files that expand without limit are refused in seconds, with little memory."""

import gzip
import json
import lzma
import struct
import sys
import time
import zlib

import numpy as np
import pytest

from adaptsize import read, read_image, read_size
from adaptsize._formats import limited
from adaptsize.errors import MeshFileError

MEGABYTE = 1 << 20
SIZE = 4096 * MEGABYTE  # what each bomb expands to


def deflated(head, tail=b""):
    """A raw deflate stream of zeros: a part that ends in a full flush can be repeated."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    first = packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH)
    part = packer.compress(bytes(MEGABYTE)) + packer.flush(zlib.Z_FULL_FLUSH)
    return first + part * (SIZE // MEGABYTE) + packer.compress(tail) + packer.flush()


def gzipped(head):
    return gzip.compress(b"")[:10] + deflated(head) + bytes(8)


def vtk_blocks(packed, size):
    n = SIZE // size
    return struct.pack(f"<{3 + n}Q", n, size, 0, *[len(packed)] * n) + packed * n


def image(compressor, packed, size):
    n = round((SIZE / 8) ** (1 / 3))
    extent = f"0 {n - 1} 0 {n - 1} 0 {SIZE // 8 // n**2 - 1}"
    return (
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64" '
        f'compressor="{compressor}"><ImageData WholeExtent="{extent}" Origin="0 0 0" '
        f'Spacing="1 1 1"><Piece Extent="{extent}"><PointData><DataArray type="Float64" Name="h" '
        'format="appended" offset="0"/></PointData></Piece></ImageData>'
        '<AppendedData encoding="raw">_'
    ).encode() + (vtk_blocks(packed, size) + b"</AppendedData></VTKFile>")


def mesh_of_vtk():
    n = SIZE // 24
    return (
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64" compressor="vtkZLibDataCompressor"><UnstructuredGrid><Piece '
        f'NumberOfPoints="{n}" NumberOfCells="1"><Points><DataArray type="Float64" '
        'NumberOfComponents="3" format="appended" offset="0"/></Points><Cells>'
        '<DataArray type="Int64" Name="connectivity">0 1 2</DataArray>'
        '<DataArray type="Int64" Name="offsets">3</DataArray>'
        '<DataArray type="UInt8" Name="types">5</DataArray></Cells></Piece></UnstructuredGrid>'
        '<AppendedData encoding="raw">_'
    ).encode() + (
        vtk_blocks(zlib.compress(bytes(MEGABYTE)), MEGABYTE) + b"</AppendedData></VTKFile>"
    )


def zipped_array():
    """An archive of NumPy with one array."""
    data = deflated(
        b"\x93NUMPY\x01\x00v\x00"
        + str({"descr": "|u1", "fortran_order": False, "shape": (1600, 1600, 1600)})
        .ljust(117)
        .encode()
        + b"\n"
    )
    name, size = b"image.npy", 1600**3 + 128
    ends = struct.pack("<IIIHH", 0, len(data), 0xFFFFFFFF & size, len(name), 0)
    local = b"PK\x03\x04" + struct.pack("<5H", 20, 0, 8, 0, 0) + ends + name + data
    central = (
        b"PK\x01\x02" + struct.pack("<6H", 20, 20, 0, 8, 0, 0) + ends
        + struct.pack("<3HII", 0, 0, 0, 0, 0) + name
    )  # fmt: skip
    return (
        local
        + central
        + b"PK\x05\x06"
        + struct.pack("<4HIIH", 0, 0, 1, 1, len(central), len(local), 0)
    )


def picture():
    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">2I5B", 65000, 65000, 8, 0, 0, 0, 0)
    data = b"\x78\xda" + deflated(b"")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def volume():
    head = np.zeros(352, np.uint8)
    head[:4] = np.array([348], "<i4").view(np.uint8)
    head[40:48] = np.array([3, 1600, 1600, 1600], "<i2").view(np.uint8)
    head[70:74] = np.array([2, 8], "<i2").view(np.uint8)
    head[108:112] = np.array([352], "<f4").view(np.uint8)
    head[344:348] = np.frombuffer(b"n+1\0", np.uint8)
    return gzipped(head.tobytes())


def nested_scene():
    """A chain of nodes, each of which contains a triangle and the next one."""
    nodes = [{"mesh": 0, "children": [i + 1]} for i in range(3000)] + [{"mesh": 0}]
    text = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64,"
                     "AACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAAAAAAIA/"}],
    }  # fmt: skip
    return json.dumps(text).encode()


LAUGHS = b"<!DOCTYPE x [<!ENTITY a0 'ha'>%s]><Xdmf>&a40;</Xdmf>" % b"".join(
    b"<!ENTITY a%d '&a%d;&a%d;&a%d;'>" % (i + 1, i, i, i) for i in range(40)
)
BOMBS = {
    "zlib.vti": lambda: image("vtkZLibDataCompressor", zlib.compress(bytes(MEGABYTE)), MEGABYTE),
    "lzma.vti": lambda: image("vtkLZMADataCompressor", lzma.compress(bytes(64 * MEGABYTE)),
                              64 * MEGABYTE),
    "zlib.vtu": mesh_of_vtk,
    "implicit.vtk": lambda: b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\n"
                            b"DIMENSIONS 2000 2000 2000\nORIGIN 0 0 0\nSPACING 1 1 1\n",
    "promised.vtk": lambda: b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n"
                            b"POINTS 99999999999 double\n0 0 0\n",
    "a.nii.gz": volume,
    "a.nrrd": lambda: b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1600 1600 1600\n"
                      b"encoding: gzip\n\n" + gzipped(b""),
    "a.npz": zipped_array,
    "a.png": picture,
    "nested.gltf": nested_scene,
    "laughs.xdmf": lambda: LAUGHS,
    "promised.ply": lambda: b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\n"
                            b"property float y\nproperty float z\nend_header\n0 0 0\n",
}  # fmt: skip


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux")
@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_ends_within_seconds_and_a_gigabyte(tmp_path, capfd, name):
    import resource

    file = tmp_path / name
    file.write_bytes(BOMBS[name]())
    assert file.stat().st_size < 6 * MEGABYTE
    reader = {"vti": read_size, "npz": read_image, "png": read_image, "gz": read_image,
              "nrrd": read_image}.get(name.rpartition(".")[2], read)  # fmt: skip
    started = time.process_time(), resource.getrusage(resource.RUSAGE_CHILDREN)
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(MeshFileError) as caught:
        reader(file)
    limited._drop()  # to see what it has used
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = time.process_time() - started[0]
    for kind in ("ru_utime", "ru_stime"):
        seconds += getattr(children, kind) - getattr(started[1], kind)
    assert seconds < 10.0  # of processor time, of both processes
    # Both are the largest so far: earlier tests of the same process may have needed more, and a
    # child begins with the memory of the process that it is forked from.
    assert children.ru_maxrss < max(1_000_000, started[1].ru_maxrss + 1, own + 1)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < max(1_000_000, own + 50_000)
    assert str(caught.value).startswith(f"{file}: ")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")
