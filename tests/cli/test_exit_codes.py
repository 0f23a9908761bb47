"""Exit codes of commands that fail: 2 if the command line must be changed, 1 for all else."""

from pathlib import Path

import numpy as np
import pytest
from command_line import call

from adaptsize import CartesianGrid, SimplexMesh, write

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with small files: plane.vtu with fields and tags, box.stl, open.stl, and others."""
    folder = tmp_path_factory.mktemp("inputs")
    plane = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]], cell_tags=[1, 2])
    fields = {"h0": [0.1, 0.2, 0.3, 0.4], "flow": np.ones((4, 2))}
    write(folder / "plane.vtu", plane, fields=fields)
    write(folder / "nan.vtu", plane, fields={"h0": [1.0, np.nan, 1.0, 1.0]})
    box = CartesianGrid([0.0] * 3, 1.0, (2, 2, 2)).mesh
    write(folder / "box.vtu", box)
    surface = box.boundary().mesh
    write(folder / "box.stl", surface)
    write(folder / "open.stl", SimplexMesh(surface.points, surface.cells[1:]))
    ring = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]])
    write(folder / "ring.vtu", ring)
    np.save(folder / "mask.npy", np.pad(np.ones((6, 6), bool), 4))
    (folder / "broken.vtu").write_text("<VTKFile")
    (folder / "part.toml").write_text("hmx = 3")
    (folder / "wrong.toml").write_text("hmax = ")
    return folder


#: What must be changed is on the command line, whatever the input is or because of it.
USAGE = {
    "size plane.vtu": "Missing option '-o'",
    "size plane.vtu -o o.vtu --hmxa 3": "No such option",
    "size plane.vtu -o o.vtu --hmax x": "--hmax must be a number, got 'x'; adaptsize size -h pri",
    "size plane.vtu -o o.vtu --hmax -1": "--hmax must be finite and > 0, got -1",
    "size plane.vtu -o o.vtu --hmin 2 --hmax 1": "--hmin must be at most --hmax = 1, got 2",
    "size plane.vtu -o o.vtu -g nan": "--g must be finite and >= 0, got nan",
    "size plane.vtu -o o.vtu --elements 100 --nodes 100": "--nodes and --elements exclude each",
    "remesh plane.vtu -o o.vtu --elements 9 --nodes 9": "--nodes and --elements exclude each",
    "adapt plane.vtu -o o.vtu --field h0 --elements 9 --nodes 9": "--elements and --nodes excl",
    "adapt plane.vtu -o o.vtu --field h0": "--elements, --nodes or --tolerance must be given",
    "size plane.vtu -o o.vtu --dofs 99 --max-memory 1GB": "--dofs and --max-memory exclude each",
    "size plane.vtu -o o.vtu --elements 9 --max-elements 8": "--elements and --max-elements ex",
    "size plane.vtu -o o.vtu --max-memory much": "--max-memory must be a text such as",
    "size plane.vtu -o o.vtu -K 3 --elements-across 1 --hmin 0.1 --hmax 0.2 --nodes 9": (
        "--nodes changes the parameters that are not given, but --elements-per-radian, "
        "--elements-across, --hmin and --hmax are all given: omit one of them, or --nodes"
    ),
    "size plane.vtu -o o.vtu --speed 3": "--speed has no effect without --cost or --parts",
    "size plane.vtu -o o.vtu --source cone:1=2": "--source must be one of point:x,y,z=h",
    "size plane.vtu -o o.vtu --source point:0,0=-1": "--source point:0,0=-1: size must be pos",
    "size plane.vtu -o o.vtu --source point:0,0,0=1": "points of a source must have shape (n, 2)",
    "size plane.vtu -o o.vtu --source region:7=1": "--source: tags must be among the cell_tags 1",
    "size plane.vtu -o o.vtu --source ball:0,0,0,1=1": "centre must have shape (2,), got (3,)",
    "size plane.vtu -o o.vtu --source box:0,0,0,1,1,1=1": "lower must have shape (2,), got (3,)",
    "size plane.vtu -o o.vtu --source region:hub=1": "among the cell_tags region 1, region 2, got",
    "size ring.vtu -o o.vtu --source boundary:7=1": "tags need a SimplexMesh, a grid has none",
    "size mask.npy -o o.vti --source region:hub=1": "labels of the image, 1; got 'hub'",
    "size mask.npy -o o.vti --source point:0,0,0=1": "points of a source must have shape (n, 2)",
    "size box.vtu -o o.vtu --source region:7=1": "tags must be region tags of the mesh, which has",
    "size plane.vtu -o o.vtu --size-of wall=1": "--size-of must name parts among",
    "size plane.vtu -o o.vtu --size-of 1=-1": "--size-of['1'] must be finite and > 0, got -1",
    "size plane.vtu -o o.vtu --label 1": "--label applies to images, got it with",
    "size plane.vtu -o o.vtu --field none": "--field must be a nodal field of the mesh (h0, ",
    "size plane.vtu -o o.vtu --field flow": "--field 'flow' must have one number per node",
    "size plane.vtu -o o.vtu --tags none": "has no cell field 'none' for tags",
    "size plane.vtu -o o.vtu --box 0,0,1,1": "--box applies to files of polygons, got",
    "size plane.vtu -o o.vtu --options part.toml": "unknown option 'hmx': did you mean 'hmax'?",
    "size plane.vtu -o o.xyz": "--output must end in a suffix that can be written",
    "size plane.vtu -o plane.vtu": "--output plane.vtu is also the input; give another name",
    "size plane.vtu -o o.vtu --plot o.doc": "--plot must end in .png",
    "remesh plane.vtu -o o.su2 --order 2": "o.su2 holds no cells of order 2",
    "remesh plane.vtu -o o.vtu --target tetrahedra": "--target 'tetrahedra' cannot be made from",
    "remesh plane.vtu -o o.vtu --backend tetwild": "--backend 'tetwild' cannot make this mesh",
    "remesh plane.vtu -o o.vtu --backend none": "--backend must be one of 'auto', 'mmg'",
    "remesh plane.vtu -o o.vtu --close-holes": "--close-holes applies to surfaces that become",
    "remesh plane.vtu -o o.vtu --least-detail 1": "--least-detail applies to surfaces, got",
    "remesh plane.vtu -o o.vtu --faces": "--faces applies to a surface in space without tags",
    "limit plane.vtu -o o.vtu -g 1 --field h0 --metric h0": "--field or --metric must be given",
    "limit plane.vtu -o o.vtu -g 1 --field h0 --method fastest": "--method must be one of",
    "family plane.vtu -o o.vtu --values 1,x": "--values must be numbers such as 1.31,1.22,1.19",
    "image mask.npy -o o.vtu --label 7": "--label must be one of 0, 1, got 7",
    "image mask.npy -o o.vtu --label 1 --threshold 0.5": "--label or --threshold must be given",
    "image mask.npy -o o.vtu --spacing 1,1,1": "--spacing must be a number or have shape (2,)",
    "info plane.vtu -q -v": "--quiet and --verbose exclude each other",
}
#: Something else is wrong: an input, what it needs, or a place.
FAILURES = {
    "info none.vtu": "none.vtu: No such file or directory",
    "info broken.vtu": "broken.vtu: ",
    "size plane.vtu -o none/o.vtu": "none/o.vtu: there is no directory none",
    "size plane.vtu -o o.vtu --plot none/o.png": "none/o.png: there is no directory none",
    "size nan.vtu -o o.vtu --field h0": "field 'h0' must not be nan, got",
    "size plane.vtu -o o.vtu --options none.toml": "none.toml: No such file or directory",
    "size plane.vtu -o o.vtu --options wrong.toml": "wrong.toml: is not TOML",
    "size plane.vtu -o o.vtu --source curve:none.txt=1": "none.txt: No such file or directory",
    "size plane.vtu -o o.vtu --hmax 0.1 --max-elements 9": "the sizes require about ",
    "remesh open.stl -o o.vtu --strict": "the surface is open: 3 open edges in 1 loop",
    "limit broken.vtu -o o.vtu -g 1 --field h0": "broken.vtu: ",
}


@pytest.mark.parametrize("line", [*USAGE, *FAILURES])
def test_exit_codes_and_names_are_those_of_the_command_line(capsys, folder, monkeypatch, line):
    monkeypatch.chdir(folder)
    code = call(*line.split())
    printed = capsys.readouterr()
    assert (code, printed.out) == (2 if line in USAGE else 1, "")
    text = " ".join(printed.err.split())
    assert (USAGE | FAILURES)[line] in text
    assert "_" not in text.replace("cell_tags", "")
