"""Nastran files in the spellings of other programs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import read
from adaptsize.errors import InputWarning, MeshFileError

POINTS = np.array([[0, 0, 0], [1.5, 0, 0], [0, -2e-3, 0], [0.25, 0.5, 3e4], [1, 1, 1]], float)
TETRAHEDRA = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
IDS = np.array([7, 3, 12, 100, 5])


def exponents(style, digits=6):
    """Return a function that writes a number with an exponent."""

    def text(x):
        mantissa, _, exponent = f"{x:.{digits}E}".partition("E")
        sign, power = exponent[0], exponent[1:].lstrip("0") or "0"
        letter = {"E": "E", "D": "D", "d": "d", "none": ""}[style]
        return f"{mantissa}{letter}{sign}{power}"

    return text


SHORT = exponents("none", 2)


def small(name, fields, number=str):
    """A card of fields of 8 characters, continued without a mark."""
    words = [word if isinstance(word, str) else number(word) for word in fields]
    lines = [words[k : k + 8] for k in range(0, len(words), 8)]
    heads = [name, *[""] * (len(lines) - 1)]
    return "\n".join(
        f"{head:<8}" + "".join(f"{word[:8]:>8}" for word in line)
        for head, line in zip(heads, lines, strict=True)
    )


def large(name, fields, number, mark):
    words = [word if isinstance(word, str) else number(word) for word in fields]
    lines = [words[k : k + 4] for k in range(0, len(words), 4)]
    text = ""
    for k, line in enumerate(lines):
        head = f"{name}*" if k == 0 else mark or "*"
        text += f"{head:<8}" + "".join(f"{word:>16}" for word in line).ljust(64)
        text += f"{mark:<8}\n" if k + 1 < len(lines) else "\n"
    return text.rstrip("\n")


def free(name, fields, number):
    words = [word if isinstance(word, str) else number(word) for word in fields]
    return ",".join([name, *words])


def deck(card, *more, case=str, head="SOL 101\nCEND\nTITLE = a mesh\nBEGIN BULK\n"):
    lines = [card("GRID", [str(n), "", *x]) for n, x in zip(IDS, POINTS.tolist(), strict=True)]
    cells = enumerate(IDS[TETRAHEDRA].tolist(), start=1)
    lines += [small("CTETRA", [str(k), str(10 * k), *map(str, nodes)]) for k, nodes in cells]
    return case("\n".join([head.rstrip("\n"), *lines, *more, "ENDDATA\n"]))


SPELLINGS = {
    "small": deck(lambda name, f: small(name, f, SHORT)),
    "small lower": deck(lambda name, f: small(name, f, SHORT), case=str.lower),
    "large D": deck(lambda name, f: large(name, f, exponents("D"), "*")),
    "large marks": deck(lambda name, f: large(name, f, exponents("E"), "*A1")),
    "large unmarked": deck(lambda name, f: large(name, f, exponents("d"), "")),
    "free": deck(lambda name, f: free(name, f, exponents("E"))),
    "free lower": deck(lambda name, f: free(name, f, exponents("none")), case=str.lower),
    "comments": deck(lambda name, f: "$ a node\n" + small(name, f, SHORT) + "  $ of the part\n"),
    "no control": deck(lambda name, f: small(name, f, SHORT), head=""),
    "other cards": deck(
        lambda name, f: small(name, f, SHORT),
        "MAT1    1       2.1+11          .3      7850.",
        "CORD2R  9       0       0.      0.      0.      0.      0.      1.",
        "+       1.      0.      1.",
        "RBE2    99      7       123456  3       12      100",
        "FORCE   2       7               100.    0.      0.      -1.",
    ),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_all_spellings_give_the_same_mesh(tmp_path, spelling):
    (tmp_path / "a.bdf").write_text(SPELLINGS[spelling])
    mesh = read(tmp_path / "a.bdf")
    assert_allclose(mesh.points, POINTS, rtol=1e-5)
    assert_array_equal(mesh.cells, TETRAHEDRA)
    assert_array_equal(mesh.cell_tags, [10, 20])


@pytest.mark.parametrize("number", [exponents("none"), lambda x: f"{x:.4g}."[:8]])
def test_shells_with_angles_and_offsets_keep_their_nodes(tmp_path, number):
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0.5, 0]]
    lines = [small("GRID", [str(k), "", *map(float, x)], lambda x: f"{x:.1f}")
             for k, x in enumerate(points, start=1)]  # fmt: skip
    quad = ["1", "4", "1", "2", "3", "4", 45.0, 0.0, "", "", 0.1, 0.1, 0.1, 0.1]
    triangle = ["2", "5", "2", "5", "3", -30.0]
    lines += [small("CQUAD4", quad, number), small("CTRIA3", triangle, number)]
    (tmp_path / "a.nas").write_text("\n".join([*lines, "ENDDATA"]))
    with pytest.warns(InputWarning, match="1 quadrilaterals split"):
        mesh = read(tmp_path / "a.nas")
    assert_array_equal(np.sort(mesh.cell_tags), [4, 4, 5])
    assert mesh.measures.sum() == pytest.approx(1.5)


@pytest.mark.parametrize("n_missing", [0, 1, 6])
def test_elements_of_order_2_may_lack_nodes_on_edges(tmp_path, n_missing):
    points = enumerate(np.random.default_rng(5181).random((10, 3)).tolist(), start=1)
    lines = [small("GRID", [str(k), "", *x], lambda x: f"{x:.2f}") for k, x in points]
    nodes = [str(k) for k in range(1, 11 - n_missing)]
    lines.append(small("CTETRA", ["1", "1", *nodes, *[""] * n_missing]))
    (tmp_path / "a.bdf").write_text("\n".join([*lines, "ENDDATA"]))
    if n_missing:
        assert_array_equal(read(tmp_path / "a.bdf").cells, [[0, 1, 2, 3]])
        return
    with pytest.warns(InputWarning, match="reduced to their corners"):
        mesh = read(tmp_path / "a.bdf")
    assert (mesh.n_points, mesh.n_cells) == (4, 1)


def test_elements_that_are_no_cells_are_counted(tmp_path):
    more = [
        "CONM2   50      7       0       1.5",
        "CBUSH   51      1       7       3",
        "CBUSH   52      1       7       12",
        "CBAR    53      9       7       3       0.",
    ]
    text = deck(lambda name, f: small(name, f, SHORT), *more)
    (tmp_path / "a.bdf").write_text(text)
    with pytest.warns(InputWarning, match="not cells left out: 1 CONM2, 2 CBUSH; "):
        assert read(tmp_path / "a.bdf").n_cells == 2
    with pytest.warns(InputWarning, match="CONM2"):
        assert read(tmp_path / "a.bdf", kind="segments").cell_tags.tolist() == [9]


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (
            "CTETRA         2",
            "CTETRA         2      20       7\n$",
            "CTETRA 2 without its 4 corners",
        ),
        ("     100", "      99", "an element with node 100, which is not in the file"),
        ("ENDDATA", "", "no ENDDATA"),
        ("GRID           7", "GRID           x", "'x' where int64 is required"),
        ("BEGIN BULK", "BEGIN BULK\nInclude 'nodes.bdf'", "has INCLUDE, which cannot be read"),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path, old, new, reason):
    text = SPELLINGS["small"]
    assert old in text
    (tmp_path / "a.bdf").write_text(text.replace(old, new, 1))
    with pytest.raises(MeshFileError, match=reason):
        read(tmp_path / "a.bdf")
