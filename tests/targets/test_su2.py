"""SU2's format as its documentation describes it: dimension, elements, points and markers."""

import numpy as np
import pytest

import adaptsize as ads
from conftest import face

#: Types of VTK: of lines, triangles and tetrahedra, and their nodes.
NODES = {3: 2, 5: 3, 10: 4}


def tables_in(path):
    """The table after each ``KEY= number``, and the names of markers."""
    tables, marker, rows = {}, None, []
    for line in path.read_text().splitlines():
        words = line.partition("%")[0].split()
        if not words:
            continue
        if "=" not in words[0]:
            rows.append(words)
            continue
        key, value = words[0].removesuffix("="), words[1]
        rows = []
        if key == "MARKER_TAG":
            marker = value
        elif key == "MARKER_ELEMS":
            tables[marker] = (int(value), rows)
        else:
            tables[key] = (int(value), rows)
    return tables


def test_su2(tmp_path, solid):
    ads.write(tmp_path / "a.su2", solid)
    tables = tables_in(tmp_path / "a.su2")
    assert tables.pop("NDIME")[0] == 3
    n_markers = tables.pop("NMARK")[0]
    n_points, rows = tables.pop("NPOIN")
    points = np.array(rows, float)[:, :3]
    assert len(points) == n_points == solid.n_points
    n_cells, rows = tables.pop("NELEM")
    cells = np.array(rows, int)
    assert (cells[:, 0] == 10).all()
    assert len(cells) == n_cells == solid.n_cells
    made = ads.SimplexMesh(points, cells[:, 1:5])
    assert made.signed_measures.min() > 0.0
    assert made.measures.sum() == pytest.approx(solid.measures.sum(), rel=1e-12)
    assert len(tables) == n_markers == len(np.unique(solid.facet_tags))
    skin = {tuple(row) for row in np.sort(made.facets, axis=1).tolist()}
    for name in ("fixed end", "1st pressed face"):
        count, rows = tables[name.replace(" ", "_")]
        facets = np.array(rows, int)
        assert (len(facets), set(facets[:, 0])) == (count, {5})
        assert {tuple(sorted(row)) for row in facets[:, 1:4].tolist()} <= skin
        area = ads.SimplexMesh(points, facets[:, 1:4]).measures.sum()
        assert area == pytest.approx(face(solid, name)[1], rel=1e-12)
