"""Random sequences of calls on one mesh, whose domain, tags and fields must stay what they are.

A mesh with regions, slits, named parts of the boundary and fields goes through files of random
formats, other packages' objects, the command line, gradient limiting, remeshing, adaptation,
transfer and motion.  The nodal fields are linear, so that they are known on each mesh.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from command_line import call
from meshes import jittered_square, slit_square
from shapes import block, two_region_block, two_region_rectangle

import adaptsize as ads

from .cases import LONGEST, Failure

#: Formats and the relative error of their coordinates.
_FORMATS = {
    ".vtu": 0.0, ".vtk": 0.0, ".vtkhdf": 0.0, ".xdmf": 0.0, ".msh": 0.0, ".mesh": 0.0,
    ".inp": 1e-12, ".bdf": 1e-8, ".su2": 1e-14, ".14": 1e-14, ".ply": 1e-6, ".obj": 1e-6,
    ".off": 1e-14,
}  # fmt: skip
#: What they hold besides cells.
_TAGS = {".vtu", ".vtk", ".vtkhdf", ".xdmf", ".msh", ".mesh"}
_FIELDS = {".vtu", ".vtk", ".vtkhdf", ".xdmf", ".msh"}
_CELL_FIELDS = _FIELDS - {".msh"}
#: Words of mesh generators that no message of ours has.
_RAW = ("WRITING DATA", "## Error", "MMG2D", "MMG3D", "Traceback")


@dataclass(frozen=True)
class State:
    """A mesh, and what is known of it."""

    mesh: ads.SimplexMesh
    slope: np.ndarray
    """float64[dim, 3]: of the nodal fields u (first column) and v (all)."""
    shift: np.ndarray
    """float64[3]"""
    heat: float
    """Integral of the cell field, over the measure."""
    loss: float = 1e-9
    """Relative error of coordinates and fields so far."""
    scale: float = 1.0
    """Length of what was 1 in the beginning."""

    @property
    def mean(self) -> float:
        """Integral of the cell field in the mesh, over the measure."""
        return float((self.mesh.cell_data["heat"] @ self.mesh.measures) / self.mesh.measures.sum())


def run(rng: np.random.Generator, folder: Path) -> str:
    """Run a sequence and return its text."""
    state, text = _begin(rng)
    done = [text]
    try:
        for number in range(int(rng.integers(3, 7))):
            step = _STEPS[int(rng.integers(len(_STEPS)))]
            done.append(step.__name__[1:])
            own = folder / str(number)
            own.mkdir()
            before = _measures(state)
            state, text = step(state, rng, own)
            done[-1] = text
            _check(state, before, text)
    except Failure as failure:
        raise Failure(f"{failure} after {', '.join(done)}") from failure.__cause__
    except Exception as error:
        raise Failure(f"{type(error).__name__}: {error} in {', '.join(done)}") from error
    return ", ".join(done)


def _begin(rng: np.random.Generator) -> tuple[State, str]:
    """Return a mesh with tags, names and fields."""
    makers: dict[str, Callable[[], ads.SimplexMesh]] = {
        "square": lambda: jittered_square(5, int(rng.integers(1000)), half_width=1.0),
        "slit": lambda: slit_square(6),
        "rectangle with regions": lambda: two_region_rectangle(4),
        "block": lambda: block(2),
        "block with regions": lambda: two_region_block(2),
        "surface": lambda: _surface(two_region_block(2)),
    }
    kind = str(rng.choice([*makers]))
    mesh = makers[kind]()
    if mesh.tagged_facets is None and mesh.cell_dim == mesh.dim:
        skin = mesh.boundary()
        facets = skin.nodes[skin.mesh.cells]
        side = mesh.points[facets].mean(axis=1)[:, 0] > 0.0
        mesh = replace(mesh, tagged_facets=facets, facet_tags=np.where(side, 4, 11))
        names = {(mesh.dim - 1, 4): "right side", (mesh.dim - 1, 11): "left"}
        mesh = replace(mesh, tag_names=names)
    slope, shift = rng.standard_normal((mesh.dim, 3)), rng.standard_normal(3)
    # Means are not conserved on surfaces.
    heat = rng.uniform(1.0, 2.0 if mesh.cell_dim == mesh.dim else 1.0, mesh.n_cells)
    values = mesh.points @ slope + shift
    mesh = mesh.with_data(
        point_data={"u": values[:, 0], "v v": values}, cell_data={"heat": heat}
    )  # fmt: skip
    state = State(mesh, slope, shift, 0.0)
    return replace(state, heat=state.mean), kind


def _surface(solid: ads.SimplexMesh) -> ads.SimplexMesh:
    """Return the boundary of a solid, its sides tagged."""
    skin = solid.boundary().mesh
    a, b, c = skin.points[skin.cells].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    side = 2 * np.abs(normals).argmax(axis=1) + (normals.max(axis=1) > 0.0)
    return ads.SimplexMesh(skin.points, skin.cells, cell_tags=side + 1)


def _measures(state: State) -> dict[str, float]:
    """Return measures of the domain, its regions and named parts, over the right power of size."""
    mesh = state.mesh
    size, unit = state.scale, state.scale**mesh.cell_dim
    found = {"measure": mesh.measures.sum() / unit}
    for tag in [] if mesh.cell_tags is None else np.unique(mesh.cell_tags).tolist():
        found[f"region {tag}"] = mesh.measures[mesh.cell_tags == tag].sum() / unit
    if mesh.tagged_facets is not None:
        areas = ads.SimplexMesh(mesh.points, mesh.tagged_facets).measures
        for tag in np.unique(mesh.facet_tags).tolist():
            name = mesh.tag_names.get((mesh.dim - 1, tag), "")
            found[f"facets {tag} {name}"] = areas[mesh.facet_tags == tag].sum() / size ** (
                mesh.dim - 1
            )
    if not mesh.is_closed:
        found["boundary"] = mesh.boundary().mesh.measures.sum() / size ** (mesh.cell_dim - 1)
    return found


def _check(state: State, before: dict[str, float], text: str) -> None:
    """Refuse another domain, other tags, and other fields."""
    after = _measures(state)
    if after.keys() != before.keys():
        raise Failure(f"{text}: has {sorted(after)}, had {sorted(before)}")
    for name, value in after.items():
        if not np.isclose(value, before[name], rtol=1e-6 + 10 * state.loss):
            raise Failure(f"{text}: {name} was {before[name]:.9g}, is {value:.9g}")
    mesh = state.mesh
    if (mesh.measures <= 0.0).any():
        raise Failure(f"{text}: {int((mesh.measures <= 0).sum())} flat cells")
    fields = {"u", "v v"} - {*mesh.point_data}
    if fields or "heat" not in mesh.cell_data:
        raise Failure(f"{text}: fields {[*mesh.point_data, *mesh.cell_data]}")
    wanted = mesh.points @ state.slope + state.shift
    room = (1e-7 + 100 * state.loss) * np.abs(wanted).max()
    for name, values in (("u", wanted[:, 0]), ("v v", wanted)):
        off = np.abs(mesh.point_data[name] - values).max()
        if not off <= room:
            raise Failure(f"{text}: {name} is off by {off:.3g}, {room:.3g} allowed")
    if not np.isclose(state.mean, state.heat, rtol=1e-6 + 10 * state.loss):
        raise Failure(f"{text}: the mean of heat was {state.heat:.9g}, is {state.mean:.9g}")


# --- steps ----------------------------------------------------------------------------------------


def _files(state: State, rng: np.random.Generator, folder: Path) -> tuple[State, str]:
    """Write and read."""
    suffix, mesh = str(rng.choice([*_FORMATS])), state.mesh
    path = folder / f"a{suffix}"
    is_surface = mesh.cell_dim < mesh.dim
    # Of solids, these hold the boundary, and SU2 has no surfaces.
    refused = {".14", ".su2"} if is_surface else {".ply", ".obj", ".off"}
    if suffix in refused or (suffix == ".14" and mesh.dim == 3):
        suffix, path = ".vtu", folder / "a.vtu"
    text = f"files {suffix}"
    written = mesh
    if suffix in (".vtk", ".ply"):  # names there have no spaces
        written = replace(mesh, point_data={"u": mesh.point_data["u"]})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ads.write(path, written)
        found = ads.read(path)
    if (found.n_points, found.n_cells) != (mesh.n_points, mesh.n_cells):
        raise Failure(f"{text}: {mesh} came back as {found}")
    error = np.abs(found.points - mesh.points).max()
    if not error <= _FORMATS[suffix] * np.abs(mesh.points).max():
        raise Failure(f"{text}: coordinates are off by {error:.3g}")
    if (np.sort(found.cells, axis=1) != np.sort(mesh.cells, axis=1)).any():
        raise Failure(f"{text}: other cells")
    if suffix in _TAGS:
        _same_tags(mesh, found, text)
    if suffix in _FIELDS:
        _same_fields(dict(written.point_data), dict(found.point_data), text)
    if suffix in _CELL_FIELDS:
        _same_fields(dict(mesh.cell_data), dict(found.cell_data), text)
    # What the format does not hold comes from the mesh that was written.
    new = replace(mesh, points=found.points)
    for name in found.point_data.keys() & {"u", "v v"}:
        new = new.with_data(point_data={name: found.point_data[name]})
    return replace(state, mesh=new, loss=state.loss + _FORMATS[suffix]), text


def _same_tags(mesh: ads.SimplexMesh, found: ads.SimplexMesh, text: str) -> None:
    if mesh.cell_tags is not None and (found.cell_tags != mesh.cell_tags).any():
        raise Failure(f"{text}: other tags of cells")
    rows = [
        sorted(zip(np.sort(m.tagged_facets, axis=1).tolist(), m.facet_tags.tolist(), strict=True))
        if m.tagged_facets is not None
        else []
        for m in (mesh, found)
    ]
    if rows[0] != rows[1]:
        raise Failure(f"{text}: other tags of facets")
    if "mesh" not in text and "xdmf" not in text and dict(mesh.tag_names) != dict(found.tag_names):
        raise Failure(f"{text}: names were {dict(mesh.tag_names)}, are {dict(found.tag_names)}")


def _same_fields(wanted: dict[str, np.ndarray], found: dict[str, np.ndarray], text: str) -> None:
    for name, values in wanted.items():
        if name not in found:
            raise Failure(f"{text}: no field {name!r} but {[*found]}")
        if np.squeeze(found[name]).shape != np.squeeze(values).shape:
            raise Failure(f"{text}: {name} has shape {found[name].shape}, had {values.shape}")
        if (np.squeeze(found[name]) != np.squeeze(values)).any():
            raise Failure(f"{text}: other values of {name}")


def _converted(state: State, rng: np.random.Generator, folder: Path) -> tuple[State, str]:
    """Convert to an object of another package and back."""
    kind = str(rng.choice(["meshio", "pyvista"]))
    mesh = state.mesh
    given = mesh.to_meshio() if kind == "meshio" else mesh.to_pyvista()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = ads.SimplexMesh.from_object(given)
    text = f"converted by {kind}"
    if (found.n_points, found.n_cells) != (mesh.n_points, mesh.n_cells):
        raise Failure(f"{text}: {mesh} came back as {found}")
    _same_fields(dict(mesh.point_data), dict(found.point_data), text)
    _same_fields(dict(mesh.cell_data), dict(found.cell_data), text)
    _same_tags(mesh, found, f"{text}, without names as xdmf")
    return replace(state, mesh=replace(mesh, points=found.points)), text


def _limited(state: State, rng: np.random.Generator, folder: Path) -> tuple[State, str]:
    """Limit a size in Python and on the command line."""
    mesh, g = state.mesh, float(rng.uniform(0.1, 0.5))
    h0 = mesh.diagonal * 10.0 ** rng.uniform(-2, 0, mesh.n_points)
    h = ads.limit_gradient(mesh, h0, g)
    if (h > h0).any() or not np.isclose(h.min(), h0.min(), rtol=1e-12):
        raise Failure("limited: above the bound, or another minimum")
    ends = h[mesh.edges]
    excess = np.abs(ends[:, 0] - ends[:, 1]) - g * mesh.edge_lengths
    if excess.max() > 1e-9 * h.max():
        raise Failure(f"limited: an edge is too steep by {excess.max():.3g}")
    ads.write(folder / "in.vtu", mesh, fields={"h0": h0})
    words = ["--field", "h0", "-g", repr(g), "-o", folder / "out.vtu"]
    if call("limit", folder / "in.vtu", *words, "-q") != 0:
        raise Failure("limited: the command fails")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        off = np.abs(ads.read(folder / "out.vtu").point_data["h"] - h).max()
    if off > 1e-12 * h.max():
        raise Failure(f"limited: the command differs from Python by {off:.3g}")
    return state, f"limited with g = {g:.3g}"


def _size(mesh: ads.SimplexMesh, rng: np.random.Generator) -> ads.SizeFunction:
    """Return sizes for up to a few hundred cells."""
    room = 0.5 if mesh.cell_dim == 2 else 0.8
    mean = room * mesh.measures.sum() ** (1.0 / mesh.cell_dim) * rng.uniform(0.2, 0.5)
    h0 = mean * 10.0 ** rng.uniform(-0.3, 0.3, mesh.n_points)
    return ads.SizeFunction(mesh, ads.limit_gradient(mesh, h0, 0.3))


def _remeshed(state: State, rng: np.random.Generator, folder: Path) -> tuple[State, str]:
    """Remesh and transfer all fields, in Python or on the command line."""
    mesh, size = state.mesh, _size(state.mesh, rng)
    by_command = bool(rng.integers(2))
    text = f"remeshed by {'the command' if by_command else 'Python'}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if by_command:
            ads.write(folder / "in.vtu", mesh, fields={"bound": size.values})
            words = ["--field", "bound", "--hmax", repr(float(size.values.max())), "-q"]
            words += ["-g", "0.3", "-o", folder / "out.vtu", "--backend", "mmg"]
            words += [] if mesh.cell_dim == mesh.dim else ["--target", "triangles"]
            code = call("remesh", folder / "in.vtu", *words)
            if code not in (0, 1):
                raise Failure(f"{text}: exits with {code}")
            new = ads.read(folder / "out.vtu")
        else:
            target = "auto" if mesh.cell_dim == mesh.dim else "triangles"
            new = ads.remesh(mesh.without_data(), size, backend="mmg", target=target)
            by_cell = {"heat": mesh.cell_data["heat"]}
            nodal = {name: mesh.point_data[name] for name in ("u", "v v")}
            moved = ads.transfer_fields(
                mesh, new, fields=nodal, cell_fields=by_cell,
                conservative=mesh.cell_dim == mesh.dim,
            )  # fmt: skip
            new = new.with_data(point_data=moved.fields, cell_data=moved.cell_fields)
    if not ads.check_mesh(new).is_met:
        raise Failure(f"{text}: {ads.check_mesh(new)}")
    return replace(state, mesh=new), text


def _adapted(state: State, rng: np.random.Generator, folder: Path) -> tuple[State, str]:
    """Adapt to an error indicator."""
    mesh = state.mesh
    eta = mesh.measures ** (1.0 / mesh.cell_dim) * 10.0 ** rng.uniform(-1, 1, mesh.n_cells)
    n = int(rng.integers(60, 250)) * (1 if mesh.cell_dim == 2 else 3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = ads.adapt(
            mesh,
            eta,
            elements=n,
            fields={name: mesh.point_data[name] for name in ("u", "v v")},
            cell_fields={"heat": mesh.cell_data["heat"]},
            backend="mmg",
            conservative=mesh.cell_dim == mesh.dim,
        )
    new = found.mesh.with_data(point_data=found.fields, cell_data=found.cell_fields)
    return replace(state, mesh=new), f"adapted to {n} elements"


def _turned(state: State, rng: np.random.Generator, folder: Path) -> tuple[State, str]:
    """Turn, scale and shift."""
    mesh = state.mesh
    turn = np.linalg.qr(rng.standard_normal((mesh.dim, mesh.dim)))[0]
    scale, away = 10.0 ** rng.uniform(-1, 1), rng.uniform(-1.0, 1.0, mesh.dim)
    points = scale * (mesh.points @ turn + away)
    # u(x) = s x + t with x = (y / scale - away) turn^T.
    slope = turn.T @ state.slope / scale
    shift = state.shift - away @ turn.T @ state.slope
    new = replace(mesh, points=points)
    text = f"turned, times {scale:.3g}"
    scaled = scale * state.scale
    return replace(state, mesh=new, slope=slope, shift=shift, scale=scaled), text


def _reordered(state: State, rng: np.random.Generator, folder: Path) -> tuple[State, str]:
    """Give nodes and cells another order."""
    mesh = state.mesh
    nodes, cells = rng.permutation(mesh.n_points), rng.permutation(mesh.n_cells)
    place = np.argsort(nodes)
    new = replace(
        mesh,
        points=mesh.points[nodes],
        cells=place[mesh.cells[cells]],
        cell_tags=None if mesh.cell_tags is None else mesh.cell_tags[cells],
        tagged_facets=None if mesh.tagged_facets is None else place[mesh.tagged_facets],
        point_data={name: values[nodes] for name, values in mesh.point_data.items()},
        cell_data={name: values[cells] for name, values in mesh.cell_data.items()},
    )
    return replace(state, mesh=new), "reordered"


def _refused(state: State, rng: np.random.Generator, folder: Path) -> tuple[State, str]:
    """Ask for what cannot be: the message is one clear line."""
    mesh = state.mesh
    cells = np.vstack([mesh.cells, mesh.cells[:1]])
    twice = replace(mesh.without_data(), cells=cells, cell_tags=None)
    bad: dict[str, Callable[[], object]] = {
        "a cell twice": lambda: ads.remesh(twice, mesh.diagonal),
        "too small": lambda: ads.remesh(mesh.without_data(), 1e-9 * mesh.diagonal),
        "a size of 0": lambda: ads.remesh(mesh.without_data(), np.zeros(mesh.n_points)),
        "an odd suffix": lambda: ads.write(folder / "a.xyz", mesh),
        "a folder": lambda: ads.write(folder, mesh),
    }
    if mesh.cell_dim < mesh.dim:  # where it is dropped with a warning
        del bad["a cell twice"]
    what = str(rng.choice([*bad]))
    try:
        bad[what]()
    except (ValueError, OSError, RuntimeError) as error:
        text = str(error)
        if "\n" in text or len(text) > LONGEST or any(word in text for word in _RAW):
            raise Failure(f"refused {what}: unclear message {text[:300]!r}") from error
    else:
        raise Failure(f"{what} was accepted")
    return state, f"refused {what}"


_STEPS = (
    _files, _files, _files, _converted, _limited, _remeshed, _remeshed, _adapted, _turned,
    _reordered, _refused,
)  # fmt: skip
