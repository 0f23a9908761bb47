"""What makes the code of the pages quick: replacements in each page, in its code and its output.

The test fails if a page does not have the text that is to be replaced.  So the figures of its
output cannot change unseen, even where only the words are compared in the coarse run.
``make pages`` compares them with a full run.
"""

import re

from page_code import NUMBER


def words(text):
    """Return the replacement of a part of the output by its words, with ``...`` for numbers."""
    return text, re.sub(NUMBER, "...", text)


FIRST = "adaptsize remesh data/bracket.stl -o bracket.vtu --plot bracket.png"
PRINTED = """\
adaptsize: sizes: 4 elements per radian, 2 across, 1 between features, ..., about 71000 elements
cells     69243 tetrahedra, 70866 predicted (-2.3%)
edges     91.7% within a factor sqrt 2 of the size
angles    dihedral, least 20.1 degrees, 1 % below 27.6
boundary  0.00086 of the diagonal from the old one, tolerance 0.001
volume    changed by +0.05%
...
bracket.vtu: 15594 points, 69243 tetrahedra, field h
"""
# The first line runs on the page that is about it.
FRONT = [
    (FIRST, ""),
    ("...\n" + "".join(PRINTED.splitlines(keepends=True)[1:3]) + "...\n", ""),
]
# What depends on the machine is replaced in the full run, too.
OF_THE_MACHINE = {
    "docs/install.md": [
        ("adaptsize warmup", ""),
    ],
}
COARSER = {
    "README.md": FRONT,
    "docs/index.md": [*FRONT, ("range(6)", "range(2)"), ("1000 *", "150 *")],
    "docs/how-to/stl.md": [
        (FIRST, f"{FIRST} --hmax 6"),
        ("-o size.vtu", "-o size.vtu --hmax 6"),
        ("data/bracket.stl", "data/box.stl"),
        words(PRINTED),
        words("..., about 15000 elements\ncells     16334 tetrahedra, 15174 predicted (+7.6%)"),
        words("bracket.vtu: 3959 points, 16334 tetrahedra, field h"),
        words(
            "3959 points, 16334 tetrahedra, 0 inverted\n"
            "length / size        5 %    25 %    50 %    75 %    95 %    mean  in band     edges\n"
            "all edges          0.690   0.859   0.993   1.131   1.341   1.000   91.69%     22616\n"
            "boundary edges     0.757   0.900   1.003   1.110   1.294   1.011   97.15%      6954\n"
        ),
        words(
            "0 of 16334 inverted or flat\nfacets    ok      0 of 34986 in more than two cells\n"
            "boundary  ok      within 0.0034 of the diagonal, 0.004 allowed\n"
            "measure   ok      changed by +0.221%, 1.56% allowed\n"
            "topology  ok      1 component(s) with Euler number -10; original: ...\n"
        ),
        # A box has no curvature.
        words("55.3% of the area,  60.0% of the elements, h from 0.7922"),
        ("curvature  controls  44.1% of the area,  40.0% of the elements, h from 1.125\n", ""),
        ("hmax       controls   0.5% of the area,   0.1% of the elements, h from 6.03\n", ""),
        words("29139 points, 58298 triangles, fields"),
        ("curvature   controls  51.0% of the area,  47.0% of the elements, h from 2.25\n", ""),
        ("width       controls  33.4% of the area,  47.9% of the elements, h from 1.69\n", ""),
        ("separation  controls   0.5% of the area,   0.4% of the elements, h from 3\n", ""),
        words("15.1% of the area,   4.7% of the elements, h from 6"),
        words("3959 points in 3-D, 16334 tetrahedra"),
        words(
            "3959 points, 16334 tetrahedra, 0 inverted\n"
            "length / size        5 %    25 %    50 %    75 %    95 %    mean  in band     edges\n"
            "all edges          0.688   0.859   0.992   1.133   1.348   1.001   91.16%     22616\n"
        ),
    ],
    "docs/how-to/vtk.md": [
        ("region:2=1 ", "region:2=3 "),
        ("30,10,10,2=0.5", "30,10,10,2=1.5"),
        ("RegionSource(2, 1.0)", "RegionSource(2, 3.0)"),
        ("tolerance=0.5, hmin=0.5, hmax=4.0", "tolerance=2.0, hmin=2.0, hmax=4.0"),
        ("--hmax 4\n", "--hmax 4 --tolerance 0.02\n"),
        ("SizeFunction(mesh, h))", "SizeFunction(mesh, h), tolerance=0.02)"),
        ("    g=0.25,\n", "    g=0.25,\n    boundary_tolerance=0.02,\n"),
        words("about 33000 elements\ncells     30563 tetrahedra, 32570 predicted (-6.2%)"),
        words("new.vtu: 5420 points, 30563 tetrahedra, 2096 tagged facets, field h"),
        words("least 16.6 degrees"),
        words("68574 tetrahedra, 12451 nodes"),
        words("smallest angle 17.9 deg"),
    ],
    "docs/how-to/export.md": [
        ("RegionSource(2, 1.5)", "RegionSource(2, 3.0)"),
        words("VERTICES       3172"),
        words("TETRAHEDRA    17203"),
    ],
    "docs/how-to/image.md": [
        words("1940 triangles\n"),
        words("1221 points, 1940 triangles, 498 tagged facets"),
        words("least 28.0 degrees, 1 % below 36.4"),
        words("731 triangles\n"),
        words("400 points, 731 triangles, 67 tagged facets"),
        # The coarse volume causes warnings.
        ("cells     3990 tetrahedra\n", "...\ncells     ... tetrahedra\n"),
        words("least 24.3 degrees"),
        ("organs.vtu: 964 points, 3990 tetrahedra, 1126", "...\norgans.vtu: ... tetrahedra, ..."),
        (
            "curvature  controls  71.0% of the area,  63.8% of the elements, h from 1\n"
            "width      controls  15.8% of the area,   8.9% of the elements, h from 1.05\n"
            "hmin       controls  13.2% of the area,  27.3% of the elements, h from 1\n",
            "hmin  ...\ncurvature  ...\nwidth  ...\nhmax  ...\n",
        ),
    ],
    "docs/tutorials/cad.md": [
        ('"flange.step")\nprint', '"flange.step", elements_per_circle=16, largest=10.0)\nprint'),
        ("(3, 1.0)", "(3, 4.0)"),
        ("(0.6, tags=foot)", "(3.0, tags=foot)"),
        (
            "elements_across=1)",
            "elements_per_radian=1.5, elements_across=0, tolerance=0.02)",
        ),
        ("2.0, 0.5)", "2.0, 2.0)"),
        ("remesh(part, size)", "remesh(part, size, tolerance=0.02)"),
        ("remesh(solid, finer)", "remesh(solid, finer, tolerance=0.02)"),
        words("6342 points in 3-D, 12692 triangles"),
        (
            "curvature  controls  54.5% of the area,  57.3% of the elements, h from 0.7239\n"
            "sources    controls  44.1% of the area,  42.6% of the elements, h from 0.6\n"
            "hmax       controls   1.5% of the area,   0.2% of the elements, h from 5\n",
            "hmax  ...\ncurvature  ...\nsources  ...\n",
        ),
        words("7966 points in 3-D, 37182 tetrahedra)\n7966 points, 37182 tetrahedra"),
        words("1.410   1.048   91.77%     48498"),
        words("20.23 deg"),
        *[words(f"{n} facets") for n in (2888, 845, 657, 1078, 1228)],
        words("9544 points in 3-D, 45594 tetrahedra"),
    ],
    "docs/tutorials/flow.md": [
        ("adapted(4000, g)", "adapted(500, g, 2)"),
        ("hmin=0.005", "hmin=0.02"),
        ("first_height=1e-3", "first_height=1e-2"),
        ("tangential=0.04", "tangential=0.2"),
        ("< 1e-3) &", "< 1e-2) &"),
        words("3789 triangles, slope of the sizes 10.74\n   smallest angle 9.2, below"),
        words("598 triangles"),
        words("3985 triangles"),
        words("smallest angle 32.6"),
        words("8534 points in 2-D, 16690 triangles)\n8534 points, 16690 triangles"),
        words("0.801   0.923   1.015   1.110   1.260   1.026   98.01%     25223"),
        words("median 1.0e-03"),
    ],
    "docs/cost.md": [("adaptsize size data/bracket.stl", "adaptsize size data/box.stl")],
    "docs/tutorials/vessels.md": [
        ("spacing = 0.5", "spacing = 0.75"),
        ("(48, 30, 72)", "(32, 20, 48)"),
        ("hmin=0.5", "hmin=0.75"),
        (
            "curvature  controls  51.9% of the volume,  59.7% of the elements, h from 0.5422\n"
            "width      controls  46.2% of the volume,  35.6% of the elements, h from 0.8748\n"
            "hmin       controls   1.9% of the volume,   4.7% of the elements, h from 0.5\n",
            "...\n",
        ),
        *[words(f"{n} facets") for n in (54, 63, 1993, 130)],
        words("1918 points, 7920 tetrahedra"),
        words("0.819   0.912   0.988   1.074   1.281   1.008   98.67%     10919"),
        words("32 facets on the left outlet, 31 on"),
    ],
    "docs/distance.md": [("spacing=1.0", "spacing=4.0")],
    "docs/width.md": [
        ("spacing=1.0", "spacing=4.0"),
        ("spacing=3.0", "spacing=12.0"),
    ],
    # The essential lines of examples.
    "examples/fem_loop.py": [("800, 1600, 3200, 6400", "400,")],
    "examples/plot_bracket.py": [("data/bracket.stl", "data/box.stl"), ("hmin=1.0", "hmin=3.0")],
    "examples/plot_lshape.py": [("0.002", "0.02")],
    "examples/plot_scan.py": [("data/deer.ply", "data/box.stl"), ("0.45, 6.0", "2.0, 6.0"),
                              ("0.45, margin=1.35", "2.0, margin=6.0")],
    "examples/plot_two_sources.py": [("20_000", "2_000")],
    "examples/plot_fichera.py": [("block.vtu", "cube.vtu"), ("20_000", "600")],
    "examples/plot_two_regions.py": [("(2, 1.0)", "(2, 3.0)"), ("10.0), 0.3)", "10.0), 2.0)")],
}  # fmt: skip
