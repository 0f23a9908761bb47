"""Remesh every surface in a folder, each in a child process, and tabulate what happened.

    python benchmarks/surfaces.py FOLDER [--names part.stl ...] [--output FILE]
    python benchmarks/surfaces.py --nasty N --seed S [--output FILE]

The outcomes are kept in FILE.jsonl, one line per surface.  A second run skips what is there, so
that an interrupted run can be resumed.  FILE is the table, in markdown.  With ``--nasty`` the
surfaces are those of `_nasty_surfaces`, and the table has a line per defect.

An outcome is of one of five kinds:

kept      a mesh without inverted cells that meets the requirements of `check_mesh` on the boundary,
          the volume and the topology
warned    a mesh without inverted cells that misses one of these, with a warning about the surface
deviates  the same without a warning
refused   an error of one line
failed    anything else: a crash, a limit of time or memory, an unclear error, inverted cells

*Made/predicted*: cells over those predicted with the sizes.  *Band*: share of the edges within
sqrt 2 of the size.  *Least*: dihedral angle in degrees.  *Quality*: least radius ratio.  *Boundary*
and *interface*: largest distance of the new one from the old one and back, over the tolerance,
which is as of the command line if it is not given.  Times are processor seconds of the process and
the mesh generators: in all, of the sizes, of each generator, and of the rest of meshing.

Below the table stands the factor of the generator for `CELLS_PER_PREDICTED` in `sizes/budget.py`:
the median of the cells made over the integral of the sizes, and how many meshes are then within
15 % of the prediction.  ``--backend`` chooses the generator.
"""

import argparse
import json
import os
import re
import resource
import signal
import statistics
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from _nasty_surfaces import write_surfaces
from _outcomes import rows_in, shown, wait
from _timing import table

import adaptsize as ads
from adaptsize._defaults import TOLERANCE
from adaptsize.sizes import Enclosed, predict

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.attack.calls import check_error
from tests.attack.cases import Failure

KINDS = ("kept", "warned", "deviates", "refused", "failed")
#: The generators, by the texts of the progress reports.
STEPS = {
    "adapting the surface with Mmg": "surface",
    "filling the surface with Netgen": "Netgen",
    "tetrahedralizing with fTetWild": "fTetWild",
    "adapting with Mmg": "Mmg",
    "": "rest",
    "sizes": "sizes",
}
COLUMNS = (
    "file",
    "cells",
    "predicted",
    "made",
    "made/predicted",
    "made/integral",
    "band",
    "least",
    "quality",
)
COLUMNS += ("boundary", "interface", "CPU s", *STEPS.values(), "MB", "kind", "outcome")
SUFFIXES = {".stl", ".off", ".obj", ".ply", ".vtk", ".vtu", ".msh", ".mesh", ".meshb"}
#: The wall time of a case is limited to this many times its processor time.
PATIENCE = 20.0
#: Requirements of `check_mesh` about the domain.
OF_DISTANCE = "boundary", "interface", "tags"
OF_DOMAIN = ("boundary", "measure", "topology")


class Clock:
    """Processor time of each step, by the texts of the progress reports."""

    def __init__(self):
        self.seconds = Counter()
        self.step, self.last = "", self._now()

    def _now(self):
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return sum(one.ru_utime + one.ru_stime for one in used)

    def __call__(self, text, _share=None):
        """Take a progress report."""
        now = self._now()
        self.seconds[self.step] += now - self.last
        self.step, self.last = STEPS.get(text, "rest"), now


def outcome_of(file, arguments):
    """Read, size, remesh and check a surface in this process."""
    row, clock = {}, Clock()
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            given = ads.read(file)
            row["cells"] = given.n_cells
            clock("sizes")
            options = {"max_elements": arguments.max_elements, "tolerance": arguments.tolerance}
            size = ads.size_function(given, **options)
            tolerance = arguments.tolerance or TOLERANCE
            clock("")
            options = {"tolerance": tolerance, "backend": arguments.backend}
            made = ads.remesh(given, size, **options, hmax=size.report.hmax, progress=clock)
            clock("")
        found = ads.size_conformity(made, size)
        check = ads.check_mesh(made, original=given, size=size, tolerance=tolerance)
    except Exception as error:
        try:
            check_error(error)
        except Failure as failure:
            return row | {"kind": "failed", "outcome": f"{failure}"}
        # An error of a mesh generator names it, all others are about the input.
        return row | {"kind": "refused", "outcome": f"{type(error).__name__}: {error}"}
    domain = given if given.cell_dim == given.dim else Enclosed(given)
    row |= {
        "predicted": round(size.report.n_elements),
        "made": made.n_cells,
        "made/predicted": round(made.n_cells / size.report.n_elements, 3),
        "made/integral": round(made.n_cells / predict(domain, size).cells, 3),
        "band": round(found.edges.share_in_band, 3),
        "least": round(found.angle_min, 1),
        "quality": float(made.radius_ratios().min()),
        **{
            d.name: d.value / d.limit
            for d in check.requirements
            if d.name in OF_DISTANCE and d.limit
        },
        **{step: round(clock.seconds[step], 1) for step in STEPS.values()},
    }
    odd = [w for w in warned if not issubclass(w.category, UserWarning)]
    if odd or found.n_inverted:
        text = f"{odd[0].category.__name__}: {odd[0].message}" if odd else "inverted cells"
        return row | {"kind": "failed", "outcome": text}
    missed = [requirement.name for requirement in check.failures if requirement.name in OF_DOMAIN]
    said = "; ".join(sorted({str(w.message).splitlines()[0][:100] for w in warned}))
    parts = [f"other {', '.join(missed)}"] if missed else []
    parts += [f"warned: {said}"] if said else []
    kind = "kept" if not missed else "warned" if said else "deviates"
    return row | {"kind": kind, "outcome": "; ".join(parts)}


def in_child(file, arguments):
    """Return the outcome of a surface, whatever happens to the process.

    The child is a copy of this process, which has loaded all kernels.
    """
    memory, seconds = int(arguments.memory * 2**30), int(arguments.timeout)
    with tempfile.TemporaryFile() as output:
        pid = os.fork()
        if pid == 0:
            try:
                os.setsid()
                os.dup2(os.open(os.devnull, os.O_RDWR), 1)
                os.dup2(1, 2)
                resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
                # Of each process: mesh generators run in processes of their own.
                resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
                row = outcome_of(file, arguments)
                output.write(json.dumps(row).encode())
                output.flush()
            finally:
                os._exit(0)
        code, usage = wait(pid, PATIENCE * arguments.timeout)
        output.seek(0)
        printed = output.read()
    spent = round(usage.ru_utime + usage.ru_stime, 1)
    figures = {"CPU s": spent, "MB": usage.ru_maxrss // 1024}
    if code != 0 or not printed:
        died = signal.Signals(-code).name if code < 0 else "an unexpected end"
        return {"kind": "failed", **figures, "outcome": died}
    row = figures | json.loads(printed)
    if "SIGXCPU" in row["outcome"]:
        row["kind"] = "failed"
    return row


def load_kernels():
    """Run what every case runs once, so that children need not load or compile it."""
    corners = np.vstack([np.zeros(3), np.eye(3)])
    surface = ads.SimplexMesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    size = ads.size_function(surface, max_elements=100)
    ads.check_mesh(surface, original=surface, size=size)


def table_of_surfaces(rows):
    """Return a line per surface, with what was said about it, and a line of counts."""
    cells = [[shown(row.get(column, "")) for column in COLUMNS] for row in rows]
    return f"{table(COLUMNS, cells)}\n\n{counts(rows)}\n{fitted(rows)}\n"


def fitted(rows):
    """Return the factor of the generator, and how many meshes it predicts."""
    ratios = np.array([row["made/integral"] for row in rows if "made/integral" in row])
    if len(ratios) == 0:
        return "No mesh was made."
    factor = float(np.median(ratios))
    close = int((np.abs(ratios / factor - 1.0) <= 0.15).sum())
    low, high = np.quantile(ratios, [0.1, 0.9])
    return (
        f"Cells made over the integral: median {factor:.2f}, 80 % between {low:.2f} and "
        f"{high:.2f}; {close} of {len(ratios)} within 15 % of the median."
    )


def table_of_defects(rows):
    """Return a line per defect, which is in the name of the file as in ``012-fins.off``."""
    groups = {}
    for row in rows:
        defect = re.sub(r"^\d+-|\.\w+$", "", row["file"]).replace("-", " ")
        groups.setdefault(defect, []).append(row)
    columns = ("defect", "surfaces", *KINDS, "median CPU s", "largest CPU s", "largest MB")
    cells = []
    for defect, of_one in [*groups.items(), ("all", rows)]:
        kinds = Counter(row["kind"] for row in of_one)
        seconds = [row["CPU s"] for row in of_one]
        spent = [f"{statistics.median(seconds):.3g}", f"{max(seconds):.3g}"]
        most = max(row["MB"] for row in of_one)
        cells.append([defect, len(of_one), *(kinds[k] or "" for k in KINDS), *spent, most])
    return f"{table(columns, cells)}\n\n{counts(rows)}\n"


def counts(rows):
    """Return how many surfaces there are of each kind."""
    kinds = Counter(row["kind"] for row in rows)
    total = ", ".join(f"{kinds[kind]} {kind}" for kind in KINDS if kinds[kind])
    return f"{len(rows)} files: {total}."


def parse():
    """Return the arguments of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("folder", nargs="?", help="with --nasty, where the surfaces are written")
    add("--names", nargs="+", default=[], help="these files of the folder only")
    add("--output", type=Path, default=Path("surfaces.md"))
    add("--nasty", type=int, default=0, help="generate so many surfaces")
    add("--seed", type=int, default=1, help="of the generated surfaces")
    add("--timeout", type=float, default=900.0, help="seconds of processor time per process")
    add("--memory", type=float, default=8.0, help="gigabytes per process")
    add("--max-elements", type=float, default=100_000.0)
    add("--tolerance", type=float, help="as of remesh")
    add("--backend", default="auto", help="as of remesh")
    arguments = parser.parse_args()
    if not arguments.folder and not arguments.nasty:
        parser.error("a folder or --nasty is needed")
    return arguments


def main():
    arguments = parse()
    folder = Path(arguments.folder or f"nasty-{arguments.seed}")
    if arguments.nasty:
        write_surfaces(folder, arguments.nasty, arguments.seed)
    files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES)
    files = [p for p in files if not arguments.names or p.name in arguments.names]
    store = arguments.output.with_suffix(arguments.output.suffix + ".jsonl")
    known = {row["file"]: row for row in rows_in(store)}
    load_kernels()
    for number, file in enumerate(files, 1):
        name = str(file.relative_to(folder))
        if name in known:
            continue
        known[name] = {"file": name, **in_child(file, arguments)}
        with open(store, "a", encoding="utf-8") as rows:
            rows.write(json.dumps(known[name]) + "\n")
        said = f"{known[name]['kind']}: {known[name]['outcome'][:120]}"
        print(f"{number} of {len(files)}: {name}: {said}", flush=True)
    chosen = [known[str(file.relative_to(folder))] for file in files]
    made = table_of_defects(chosen) if arguments.nasty else table_of_surfaces(chosen)
    arguments.output.write_text(made, encoding="utf-8")
    bad = sum(row["kind"] == "failed" for row in chosen)
    print(f"{len(files)} files, {bad} failed; {arguments.output}")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
