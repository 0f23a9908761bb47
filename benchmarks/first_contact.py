"""What `adaptsize remesh` makes of a folder of surfaces, without options.

    python benchmarks/first_contact.py FOLDER [--names part.stl joint.stl ...] [--elements N]

Closed surfaces of the folder, or the named files.  *Predicted* and *made*: numbers of tetrahedra.
*Band*: share of the edges within sqrt 2 of the size.  *Least* and *1 %*: dihedral angles in
degrees.  *New to old*: distance of the new boundary from the old surface, in 1e-3 of the diagonal;
*old to new*: the other way; both at nodes, midpoints of edges and centroids.  *Over tolerance*: the
larger of the two over the tolerance.  Then processor seconds of this process and the generators,
after a first mesh that compiles the kernels: in all, and for each step.  Writes `first_contact.md`
and `first_contact.json`; if it is interrupted, with the parts so far.
"""

import argparse
import resource
import warnings
from pathlib import Path

import numpy as np
from _timing import machine, table, write

import adaptsize as ads
from adaptsize.domain_size import size_function
from adaptsize.domain_size.elements import remesh_to_elements, tolerance_of
from adaptsize.quality import minimum_angles, size_conformity
from adaptsize.quality.boundary import distances_from
from adaptsize.remeshing import open_boundary
from adaptsize.remeshing.hole_filling import merged_surface

STEPS = {
    "adapting the surface with Mmg": "surface",
    "filling the surface with Netgen": "Netgen",
    "tetrahedralizing with pytetwild": "fTetWild",
    "adapting with Mmg": "Mmg",
}
OTHER = "sizes"
HEADS = ["part", "triangles", "predicted", "made", "made / predicted", "band", "least", "1 %"]
HEADS += ["new to old", "old to new", "over tolerance", "s", *STEPS.values(), OTHER]


def processor_seconds():
    """Return the processor time of this process and its children that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


class Clock:
    """Processor time of each step, by the texts of the progress reports."""

    def __init__(self):
        self.seconds = dict.fromkeys([*STEPS.values(), OTHER], 0.0)
        self.step, self.last = OTHER, processor_seconds()

    def __call__(self, text, _share):
        """Take a progress report."""
        self.begin(STEPS.get(text, OTHER))

    def begin(self, step):
        """End the present step."""
        now = processor_seconds()
        self.seconds[self.step] += now - self.last
        self.step, self.last = step, now


def closed_surfaces(folder, names):
    """Yield the names and meshes of the closed surfaces of a folder."""
    for file in sorted(folder / name for name in names) if names else sorted(folder.iterdir()):
        try:
            mesh = ads.read(file)
        except (OSError, ValueError):
            continue
        if not isinstance(mesh, ads.SimplexMesh) or (mesh.dim, mesh.cell_dim) != (3, 2):
            continue
        if mesh.diagonal > 0.0 and open_boundary(mesh) is None:
            yield file.name, mesh


def meshed(mesh, elements):
    """Return the new mesh, its size function, the report, and the clock."""
    clock = Clock()
    if elements is not None:
        new, size, report = remesh_to_elements(mesh, elements, progress=clock)
    else:
        size, report = size_function(mesh, full_output=True)
        tolerance = tolerance_of(report, None)
        new = ads.remesh(mesh, size, hmax=report.hmax, tolerance=tolerance, progress=clock)
    clock.begin(OTHER)
    return new, size, report, clock


def row_of(name, mesh, elements):
    """Return the figures of one part."""
    new, size, report, clock = meshed(mesh, elements)
    old, skin = merged_surface(mesh), new.boundary().mesh
    angles = minimum_angles(new)
    away = [distances_from(skin, old).largest, distances_from(old, skin).largest]
    wanted = elements or report.n_elements
    return {
        "part": name,
        "triangles": mesh.n_cells,
        "predicted": round(wanted),
        "made": new.n_cells,
        "made / predicted": round(new.n_cells / wanted, 2),
        "band": f"{size_conformity(new, size).share_in_band:.1%}",
        "least": round(float(angles.min()), 1),
        "1 %": round(float(np.quantile(angles, 0.01)), 1),
        "new to old": round(1e3 * away[0] / mesh.diagonal, 2),
        "old to new": round(1e3 * away[1] / mesh.diagonal, 2),
        "over tolerance": round(max(away) / mesh.diagonal / tolerance_of(report, None), 2),
        "s": round(sum(clock.seconds.values()), 1),
        **{step: round(seconds, 1) for step, seconds in clock.seconds.items()},
    }


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--names", nargs="+", default=[])
    parser.add_argument("--elements", type=float)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    meshed(ads.read(Path(__file__).parents[1] / "data" / "bracket.stl"), 2000)
    rows = []
    try:
        for name, mesh in closed_surfaces(given.folder, given.names):
            try:
                rows.append(row_of(name, mesh, given.elements))
            except (RuntimeError, ValueError) as error:
                rows.append({"part": name, "triangles": mesh.n_cells, "predicted": repr(error)})
            print(" ".join(str(value) for value in rows[-1].values()), flush=True)
    finally:
        lines = table(HEADS, [[row.get(head, "") for head in HEADS] for row in rows])
        total = sum(row.get("s", 0.0) for row in rows)
        text = f"{lines}\n\nIn all {total:.0f} s.  {machine()}.\n"
        write(given.output, "first_contact", text, rows)


if __name__ == "__main__":
    main()
