"""STL files, text and binary."""

import struct

import numpy as np

ASCII_STL = """solid two triangles
facet normal 0 0 1
  outer loop
    vertex 0 0 1
    vertex 1 0 1
    vertex 1 1 1
  endloop
endfacet
facet normal 0 0 1
  outer loop
    vertex -0 0 1
    vertex 1.0e0 1 1
    vertex 0 1 1
  endloop
endfacet
endsolid
"""


def binary_stl(corners, *, header=b"", count=None, tail=b""):
    corners = np.asarray(corners, dtype="<f4").reshape(-1, 9)
    rows = b"".join(struct.pack("<3f", 0, 0, 0) + c.tobytes() + b"\0\0" for c in corners)
    return (
        header.ljust(80) + struct.pack("<I", len(corners) if count is None else count) + rows + tail
    )
