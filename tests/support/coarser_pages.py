"""What makes the code of the pages quick: replacements in each page, in its code and its output.

The test fails if a page does not have the text that is to be replaced.  Where the figures change,
only the words of the output are compared; ``make pages`` compares the figures, too.
"""

FIRST = "adaptsize remesh data/bracket.stl -o bracket.vtu --plot bracket.png"
# The first line runs on the page that is about it.
PRINTED = """\
...
cells     68209 tetrahedra, 69671 predicted (-2.1%)
edges     92.3% within a factor sqrt 2 of the size
served    99.7% of the requested elements, 0.2% too coarse
...
"""
FRONT = [(FIRST, ""), (PRINTED, "")]
# What depends on the machine is replaced in the full run, too.
OF_THE_MACHINE = {
    "docs/install.md": [("adaptsize warmup", "")],
}
#: Pages on which coarser meshes have other figures.
OTHER_FIGURES = {
    *(f"docs/how-to/{name}.md" for name in ("export", "image", "stl", "vtk")),
    *(f"docs/tutorials/{name}.md" for name in ("cad", "flow", "vessels")),
}
COARSER = {
    "README.md": FRONT,
    "docs/index.md": [*FRONT, ("range(6)", "range(2)"), ("1000 *", "150 *")],
    "docs/how-to/stl.md": [
        (FIRST, f"{FIRST} --hmax 6"),
        ("-o size.vtu", "-o size.vtu --hmax 6"),
        ("data/bracket.stl", "data/box.stl"),
        # A box has no curvature.
        ("curvature  controls  43.6% of the area,  39.4% of the elements, h from 1.125\n", ""),
        ("hmax       controls   0.6% of the area,   0.1% of the elements, h from 6.03\n", ""),
        ("curvature   controls  50.6% of the area,  46.9% of the elements, h from 2.25\n", ""),
        ("width       controls  33.3% of the area,  47.9% of the elements, h from 1.69\n", ""),
        ("separation  controls   0.5% of the area,   0.4% of the elements, h from 3\n", ""),
        ("1.53% allowed by the tolerance", "0.5% allowed"),
    ],
    "docs/how-to/vtk.md": [
        ("region:2=1 ", "region:2=3 "),
        ("30,10,10,2=0.5", "30,10,10,2=1.5"),
        ("RegionSource(2, 1.0)", "RegionSource(2, 3.0)"),
        ("tolerance=0.5, hmin=0.5, hmax=4.0", "tolerance=2.0, hmin=2.0, hmax=4.0"),
        ("--hmax 4\n", "--hmax 4 --tolerance 0.02\n"),
        ("SizeFunction(mesh, h))", "SizeFunction(mesh, h), tolerance=0.02)"),
        ("    g=0.25,\n", "    g=0.25,\n    boundary_tolerance=0.02,\n"),
    ],
    "docs/how-to/export.md": [
        ("RegionSource(2, 1.5)", "RegionSource(2, 3.0)"),
        ("data/bracket.stl", "data/box.stl"),
    ],
    "docs/how-to/image.md": [
        # The coarse volume causes warnings.
        ("cells     3835 tetrahedra\n", "...\ncells     ... tetrahedra\n"),
        (
            "served    100.0% of the requested elements, 0.0% too coarse\n"
            "angles    dihedral, least 23.0 degrees, 1 % below 28.7\n",
            "...\n",
        ),
        ("region 1  volume 642451, changed by -0.01%\n", ""),
        ("region 2  volume 120272, changed by -0.09%\n", ""),
        ("organs.vtu: 935 points, 3835 tetrahedra, 1102", "...\norgans.vtu: ... tetrahedra, ..."),
        (
            "curvature  controls  68.5% of the area,  62.8% of the elements, h from 1.001\n"
            "hmin       controls  16.5% of the area,  29.2% of the elements, h from 1\n"
            "width      controls  14.9% of the area,   7.9% of the elements, h from 1.105\n",
            "hmin  ...\ncurvature  ...\nwidth  ...\nhmax  ...\n",
        ),
    ],
    "docs/tutorials/cad.md": [
        ('"flange.step")\nprint', '"flange.step", elements_per_circle=16, largest=10.0)\nprint'),
        ("(3, 1.0)", "(3, 4.0)"),
        ("(0.6, tags=foot)", "(3.0, tags=foot)"),
        ("elements_across=1)", "elements_per_radian=1.5, elements_across=0, tolerance=0.02)"),
        ("2.0, 0.5)", "2.0, 2.0)"),
        ("remesh(part, size)", "remesh(part, size, tolerance=0.02)"),
        ("remesh(solid, finer)", "remesh(solid, finer, tolerance=0.02)"),
        (
            "curvature  controls  50.0% of the area,  51.2% of the elements, h from 0.7239\n"
            "sources    controls  48.5% of the area,  48.6% of the elements, h from 0.6\n"
            "hmax       controls   1.5% of the area,   0.2% of the elements, h from 5\n",
            "hmax  ...\ncurvature  ...\nsources  ...\n",
        ),
    ],
    "docs/tutorials/flow.md": [
        ("adapted(4000, g)", "adapted(500, g, 2)"),
        ("hmin=0.005", "hmin=0.02"),
        ("first_height=1e-3", "first_height=1e-2"),
        ("tangential=0.04", "tangential=0.2"),
        ("< 1e-3) &", "< 1e-2) &"),
    ],
    "docs/cost.md": [("adaptsize size data/bracket.stl", "adaptsize size data/box.stl")],
    "docs/tutorials/vessels.md": [
        ("spacing = 0.5", "spacing = 0.75"),
        ("(48, 30, 72)", "(32, 20, 48)"),
        ("hmin=0.5", "hmin=0.9"),
        (
            "curvature  controls  50.3% of the volume,  44.2% of the elements, h from 0.5179\n"
            "width      controls  46.9% of the volume,  40.5% of the elements, h from 0.51\n"
            "hmin       controls   2.8% of the volume,  15.3% of the elements, h from 0.5\n",
            "...\n",
        ),
    ],
    "docs/distance.md": [("spacing=1.0", "spacing=4.0")],
    "docs/width.md": [("spacing=1.0", "spacing=4.0"), ("spacing=3.0", "spacing=12.0")],
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
