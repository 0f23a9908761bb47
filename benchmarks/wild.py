"""Remesh real and generated surfaces by the command, and judge the meshes by independent measures.

    python benchmarks/wild.py FOLDER [--names part.stl ...] [--caps none 10000] [--output FILE]
    python benchmarks/wild.py --generated 200 --seed 1 [--only 0 10 20] [--output FILE]

Each surface is remeshed by ``adaptsize remesh`` once per cap of the number of elements, and once by
fTetWild alone with the same tolerance, in child processes with a limit of time.  `judge.py` says
what is measured; ``--judge-python`` names the Python of an environment with libigl.  What stands
after ``--`` is passed to the command.

A run is *late* if neither its time nor its processor time keeps the limit; on a machine that others
use, ``--patience`` lets it go on until then.

The outcomes are kept in FILE.jsonl, one line per run.  A second run skips what is there, so that an
interrupted run can be resumed.  FILE is the table, in markdown, with a summary per cap.

*Exit*: the code, and whether it agrees with the measures: 0 needs a mesh that meets all of them
with 10 % more than the tolerance; 1 needs one that misses some, or no mesh.  *H*: the larger
distance, over the tolerance.  *Least*: dihedral angle in degrees, and the number of cells below 8,
10 and 15.  *Volume*: change in percent.  *Odd*: edges of the boundary that are not in two facets,
inverted cells.  *CPU s*: of the process and all that it started.
"""

import argparse
import json
import os
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from _outcomes import rows_in, wait
from _timing import table, three
from judge import is_true, judged, missed, read_mesh, read_surface

HERE = Path(__file__).parent
SUFFIXES = {".stl", ".off", ".obj", ".ply", ".vtp"}
TOLERANCE = 1e-3
OURS, THEIRS = "adaptsize", "fTetWild"
HEADS = ["part", "cap", "exit", "true", "missed", "cells", "made / predicted", "H", "least"]
HEADS += ["< 8, 10, 15", "volume %", "odd", "band %", "CPU s"]
HEADS += [f"{THEIRS}: cells", "H", "least", "volume %", "CPU s"]


# --- runs -----------------------------------------------------------------------------------------


def ours(part, cap, folder, given):
    """Return the command that remeshes a part, and the file of the mesh."""
    output = Path(folder) / "made.vtu"
    command = [sys.executable, "-m", "adaptsize", "remesh", str(part), "-o", str(output)]
    command += [] if cap is None else ["--max-elements", str(cap)]
    command += [] if given.tolerance == TOLERANCE else ["--tolerance", repr(given.tolerance)]
    return [*command, *given.options], output


def theirs(part, _cap, folder, given):
    """Return the command that runs fTetWild alone, and the file of the mesh."""
    output = Path(folder) / "made.npz"
    script = str(HERE / "_tetwild_alone.py")
    return [sys.executable, script, str(part), str(output), repr(given.tolerance)], output


PROGRAMS = {OURS: ours, THEIRS: theirs}


def run(part, cap, program, given):
    """Return the outcome of one run, with the measures of its mesh."""
    with tempfile.TemporaryDirectory() as folder:
        command, output = PROGRAMS[program](part, cap, folder, given)
        row = in_child(command, Path(folder), given)
        row["predicted"] = predicted(output)
        reference = part.with_suffix(".reference.npz")
        surface = read_surface(reference if reference.exists() else part)
        mesh = read_mesh(output) if output.exists() else None
        row["found"] = judged(surface, mesh, given.tolerance, given.judge_python)
    return row


def in_child(command, folder, given):
    """Run a command with limits; return its exit code, None if it took too long, and its use."""
    with open(folder / "said.txt", "wb") as said:
        begin = time.monotonic()
        memory = int(given.memory * 2**30)
        limits = {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))}
        child = subprocess.Popen(
            command, cwd=folder, stdout=said, stderr=said, start_new_session=True, **limits
        )
        code, usage = wait(child.pid, given.patience * given.timeout)
        child.returncode = code
    wall, spent = time.monotonic() - begin, usage.ru_utime + usage.ru_stime
    lines = (folder / "said.txt").read_text("utf-8", "replace").strip().splitlines()
    return {
        "code": None if code == -signal.SIGKILL or min(wall, spent) >= given.timeout else code,
        "wall": round(wall, 1),
        "CPU s": round(spent, 1),
        "MB": usage.ru_maxrss // 1024,
        "said": [line[:300] for line in lines[-12:]],
    }


def predicted(output):
    """Return the number of cells predicted with the sizes, which stands beside the mesh."""
    record = Path(f"{output}.json")
    return json.loads(record.read_text())["sizes"]["n_elements"] if record.exists() else None


# --- tables ---------------------------------------------------------------------------------------


def has_mesh(row):
    return row is not None and "cells" in row["found"]


def line_of(row, other):
    """Return the cells of a line: a run of ours, and that of fTetWild on the same part."""
    found = row["found"] if has_mesh(row) else None
    verdict = is_true(row["code"], found, row["cap"])
    code = "late" if row["code"] is None else row["code"]
    line = [
        row["part"],
        row["cap"] or "none",
        code,
        {True: "yes", False: "**no**", None: "-"}[verdict],
    ]
    if found is None:
        line += ["no mesh"] + [""] * (len(HEADS) - 11) + [row["CPU s"]]
    else:
        ratio = found["cells"] / row["predicted"] if row["predicted"] else None
        below = ", ".join(str(found.get(f"below_{limit}", "")) for limit in (8, 10, 15))
        odd = [found["edges_not_manifold"], found.get("inverted", 0)]
        line += [", ".join(missed(found, row["cap"])) or "-", found["cells"], figure(ratio)]
        line += [figure(found["H"]), figure(found.get("least")), below]
        line += [percent(found["volume_change"]), ", ".join(map(str, odd))]
        line += [figure(100.0 * found["band"]) if "band" in found else "", row["CPU s"]]
    if not has_mesh(other):
        return [*line, "no mesh" if other else "", "", "", "", other["CPU s"] if other else ""]
    found = other["found"]
    figures = [figure(found["H"]), figure(found["least"]), percent(found["volume_change"])]
    return [*line, found["cells"], *figures, other["CPU s"]]


def figure(value):
    return "" if value is None else three(value)


def percent(value):
    return "" if value is None else f"{100.0 * value:+.2f}"


def summary(rows, others):
    """Return the figures that the runs with one cap must show; parts that enclose a solid count."""
    solid = [row for row in rows if row["found"]["encloses"]]
    made = [row for row in solid if has_mesh(row)]
    found = [row["found"] for row in made]
    verdicts = [is_true(r["code"], r["found"] if has_mesh(r) else None, r["cap"]) for r in rows]
    pairs = [(row, others[row["part"]]) for row in solid if has_mesh(others.get(row["part"]))]
    ratios = [
        f["cells"] / row["predicted"]
        for f, row in zip(found, made, strict=True)
        if row["predicted"]
    ]
    keeps = sum(f["H"] is not None and f["H"] <= 1.05 for f in found)
    not_worse = sum(has_mesh(a) and a["found"]["H"] <= max(b["found"]["H"], 1.0) for a, b in pairs)
    sharp = sum(f.get("below_8", 0) > 0 for f in found)
    pinched = sum(f["edges_not_manifold"] > f["odd_edges_of_part"] for f in found)
    seconds = [row["CPU s"] for row in rows]
    theirs = [others[row["part"]]["CPU s"] for row in rows if row["part"] in others]
    close = sum(abs(ratio - 1.0) <= 0.15 for ratio in ratios)
    many = sum("number" in missed(row["found"], row["cap"]) for row in made)
    n = len(solid)
    lines = [
        f"{len(rows)} parts, {n} of them enclose a solid, {len(made)} of these became a mesh",
        f"H <= 1.05: {keeps} of {n} (at least 90 % wanted)",
        f"H <= that of {THEIRS}, or <= 1: {not_worse} of {len(pairs)} (95 %)",
        f"exit code true: {sum(v is not False for v in verdicts)} of {len(rows)} (all)",
        f"least angle >= 15: {sum(f.get('least', 0.0) >= 15.0 for f in found)} of {n} (90 %)",
        f"with cells below 8 degrees: {sharp} (none)",
        f"boundary not manifold where that of the part is: {pinched} (none)",
        f"inverted or overlapping cells: {sum('cells' in missed(f) for f in found)} (none)",
        f"volume missed: {sum('volume' in missed(f) for f in found)}",
        f"no answer in time: {sum(row['code'] is None for row in rows)} (none)",
        f"more than 10 % above the cap: {many} (none)",
        f"within 15 % of the prediction: {close} of {len(ratios)} (90 %)",
        f"80 % of the edges in the band: {sum(f.get('band', 0.0) >= 0.8 for f in found)} of {n}",
        f"median CPU s: {statistics.median(seconds):.3g}"
        + (f"; {THEIRS} alone: {statistics.median(theirs):.3g}" if theirs else ""),
    ]
    return "\n".join(f"- {line}" for line in lines)


def report(rows):
    """Return the summaries and the table."""
    others = {row["part"]: row for row in rows if row["program"] == THEIRS}
    mine = [row for row in rows if row["program"] == OURS]
    parts = []
    for cap in dict.fromkeys(row["cap"] for row in mine):
        of_cap = [row for row in mine if row["cap"] == cap]
        parts += [f"Cap {cap or 'none'}:", "", summary(of_cap, others), ""]
    parts.append(table(HEADS, [line_of(row, others.get(row["part"])) for row in mine]))
    return "\n".join([*parts, ""])


# --- the command line -----------------------------------------------------------------------------


def parse():
    """Return the arguments of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("folder", nargs="?", type=Path, help="with --generated, where the surfaces are written")
    add("--names", nargs="+", help="these files of the folder only")
    add("--generated", type=int, default=0, help="generate so many surfaces")
    add("--seed", type=int, default=1, help="of the generated surfaces")
    add("--only", type=int, nargs="+", help="these numbers of the generated surfaces only")
    add(
        "--caps", nargs="+", default=["none", "40000", "10000"], help="numbers of elements, or none"
    )
    add("--tolerance", type=float, default=TOLERANCE, help="over the diagonal")
    add("--timeout", type=float, default=300.0, help="seconds per run")
    add("--patience", type=float, default=1.0, help="times the limit, where others use the machine")
    add("--memory", type=float, default=8.0, help="gigabytes per process")
    add("--judge-python", default=sys.executable, help="of an environment with libigl")
    add("--without-tetwild", action="store_true", help=f"do not run {THEIRS}")
    add("--output", type=Path, default=Path("wild.md"))
    words = sys.argv[1:]
    cut = words.index("--") if "--" in words else len(words)
    given = parser.parse_args(words[:cut])
    given.options = words[cut + 1 :]
    given.caps = [None if cap == "none" else int(float(cap)) for cap in given.caps]
    if not given.folder and not given.generated:
        parser.error("a folder or --generated is needed")
    return given


def files_of(given):
    """Return the surfaces."""
    if given.generated:
        from _wild_surfaces import write_parts

        folder = given.folder or Path(f"wild-{given.seed}")
        files = write_parts(folder, given.generated, given.seed)
        return files if given.only is None else [files[number] for number in given.only]
    files = sorted(p for p in given.folder.rglob("*") if p.suffix.lower() in SUFFIXES)
    return [p for p in files if given.names is None or p.name in given.names]


def main():
    given = parse()
    files = files_of(given)
    store = given.output.with_suffix(given.output.suffix + ".jsonl")
    known = {(row["part"], row["cap"], row["program"]): row for row in rows_in(store)}
    wanted = [(file, cap, OURS) for file in files for cap in given.caps]
    if not given.without_tetwild:
        wanted += [(file, None, THEIRS) for file in files]
    os.makedirs(given.output.parent, exist_ok=True)
    for number, (file, cap, program) in enumerate(wanted, 1):
        key = (file.name, cap, program)
        if key in known:
            continue
        row = {"part": file.name, "cap": cap, "program": program}
        known[key] = row | run(file.resolve(), cap, program, given)
        with open(store, "a", encoding="utf-8") as rows:
            rows.write(json.dumps(known[key]) + "\n")
        found = known[key]["found"]
        said = f"H {figure(found.get('H'))}, least {figure(found.get('least'))}"
        said += f", exit {known[key]['code']}, CPU {known[key]['CPU s']} s"
        print(
            f"{number} of {len(wanted)}: {file.name}, {cap or 'no cap'}, {program}: {said}",
            flush=True,
        )
    chosen = [known[(file.name, cap, program)] for file, cap, program in wanted]
    text = report(chosen)
    given.output.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
