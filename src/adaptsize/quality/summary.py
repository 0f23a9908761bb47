"""Summary of a mesh."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.geometry.solid import Solid
from adaptsize.quality.boundary import n_components
from adaptsize.quality.elements import flat_cells, minimum_angles, radius_ratios

_KINDS = {1: "segments", 2: "triangles", 3: "tetrahedra"}
_MEASURES = {"segments": "length", "triangles": "area", "tetrahedra": "volume"}


@dataclass(frozen=True)
class MeshSummary:
    """Counts, extent, tags, fields, topology and quality of a mesh."""

    n_points: int
    n_cells: int
    kind: str
    """``"segments"``, ``"triangles"`` or ``"tetrahedra"``."""
    dim: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    diagonal: float
    measure: float
    """Length, area or volume of all cells."""
    enclosed: float | None
    """Volume that a closed surface in space encloses: that of the union of its bodies."""
    n_flipped_facets: int
    """Triangles of a surface in space whose orientation contradicts that of the others; all if
    their normals point inward."""
    edge_min: float
    edge_median: float
    edge_max: float
    cell_tags: dict[int, int]
    """Number of cells by tag."""
    cell_tag_names: dict[int, str]
    """Names of cell tags that have one: physical groups of Gmsh."""
    facet_tags: dict[int, int]
    """Number of tagged facets by tag."""
    facet_tag_names: dict[int, str]
    """Names of facet tags that have one."""
    point_fields: tuple[str, ...]
    cell_fields: tuple[str, ...]
    n_components: int
    n_boundary_facets: int
    """Facets of only one cell; 0 if the mesh is closed."""
    n_nonmanifold_facets: int
    """Facets of three cells or more."""
    n_unused_points: int
    n_duplicate_points: int
    n_degenerate_cells: int
    """Cells of measure zero, up to rounding; `check_mesh` refuses them."""
    radius_ratio_median: float | None
    angle_min: float | None
    """Smallest (dihedral) angle in degrees; None for segments."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers, strings, lists and dictionaries, suitable for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        """Return one line per topic."""
        box = " x ".join(f"[{a:g}, {b:g}]" for a, b in zip(self.lower, self.upper, strict=True))
        closed = ""
        if self.kind == "triangles" and self.dim == 3:
            closed = "closed, " if self.n_boundary_facets == 0 else "open, "
        facets = f"{self.n_boundary_facets} boundary, {self.n_nonmanifold_facets} non-manifold"
        rows = [
            ("cells", f"{self.n_cells} {self.kind}, {self.n_points} points in {self.dim}-D"),
            ("box", f"{box}, diagonal {self.diagonal:g}"),
            (_MEASURES[self.kind], f"{self.measure:g}"),
            *self._of_surfaces(),
            ("edges", f"{self.edge_min:g} to {self.edge_max:g}, median {self.edge_median:g}"),
            ("topology", f"{closed}{self.n_components} component(s), facets: {facets}"),
            ("cell tags", _counted(self.cell_tags, self.cell_tag_names)),
            ("facet tags", _counted(self.facet_tags, self.facet_tag_names)),
            ("point fields", ", ".join(self.point_fields) or "none"),
            ("cell fields", ", ".join(self.cell_fields) or "none"),
            ("points", f"{self.n_duplicate_points} duplicate, {self.n_unused_points} unused"),
        ]
        if self.radius_ratio_median is not None:
            quality = (
                f"median radius ratio {self.radius_ratio_median:.3f}, smallest angle "
                f"{self.angle_min:.3g} degrees, {self.n_degenerate_cells} degenerate"
            )
            rows.append(("quality", quality))
        return "\n".join(f"{name:13}{text}" for name, text in rows)

    def _of_surfaces(self) -> list[tuple[str, str]]:
        """Return the lines on surfaces in space."""
        lines = [] if self.enclosed is None else [("encloses", f"{self.enclosed:g}")]
        if self.n_flipped_facets > 0:
            text = f"{self.n_flipped_facets} of {self.n_cells} facets are flipped"
            lines.append(("orientation", f"{text}; sizes and volume meshes do not depend on it"))
        return lines


def _enclosed(mesh: SimplexMesh) -> tuple[float | None, int]:
    """Return the volume that a surface in space encloses, and the number of flipped facets."""
    if (mesh.cell_dim, mesh.dim) != (2, 3) or mesh.diagonal == 0.0:
        return None, 0
    solid = Solid.of(mesh)
    volume = solid.volume if solid.is_closed else None
    return volume, int(np.count_nonzero(solid.flipped))


def summarize(mesh: SimplexMesh) -> MeshSummary:
    """Return counts, extent, tags, fields, topology and quality of a mesh.

    See `SimplexMesh.summarize`.
    """
    mesh = as_mesh("mesh", mesh)
    used = np.unique(mesh.cells)
    cell_tags, facet_tags = _counts(mesh.cell_tags), _counts(mesh.facet_tags)
    points = mesh.points[used]
    enclosed, n_flipped = _enclosed(mesh)
    ratios = None if mesh.cell_dim == 1 else radius_ratios(mesh)
    return MeshSummary(
        n_points=mesh.n_points,
        n_cells=mesh.n_cells,
        kind=_KINDS[mesh.cell_dim],
        dim=mesh.dim,
        lower=tuple(points.min(axis=0).tolist()),
        upper=tuple(points.max(axis=0).tolist()),
        diagonal=mesh.diagonal,
        measure=float(mesh.measures.sum()),
        enclosed=enclosed,
        n_flipped_facets=n_flipped,
        edge_min=float(mesh.edge_lengths.min()),
        edge_median=float(np.median(mesh.edge_lengths)),
        edge_max=float(mesh.edge_lengths.max()),
        cell_tags=cell_tags,
        cell_tag_names=_names(mesh, mesh.cell_dim, cell_tags),
        facet_tags=facet_tags,
        facet_tag_names=_names(mesh, mesh.cell_dim - 1, facet_tags),
        point_fields=tuple(mesh.point_data),
        cell_fields=tuple(mesh.cell_data),
        n_components=n_components(mesh),
        n_boundary_facets=int((mesh.facet_cell_counts == 1).sum()),
        n_nonmanifold_facets=int((mesh.facet_cell_counts > 2).sum()),
        n_unused_points=mesh.n_points - len(used),
        n_duplicate_points=mesh.n_points - len(np.unique(mesh.points, axis=0)),
        n_degenerate_cells=int(np.count_nonzero(flat_cells(mesh))),
        radius_ratio_median=None if ratios is None else float(np.median(ratios)),
        angle_min=None if ratios is None else round(float(minimum_angles(mesh).min()), 9),
    )


def _counts(tags: Any) -> dict[int, int]:
    if tags is None:
        return {}
    unique, counts = np.unique(tags, return_counts=True)
    return dict(zip(unique.tolist(), counts.tolist(), strict=True))


def _names(mesh: SimplexMesh, dim: int, tags: dict[int, int]) -> dict[int, str]:
    return {tag: mesh.tag_names[dim, tag] for tag in tags if (dim, tag) in mesh.tag_names}


def _counted(counts: dict[int, int], names: dict[int, str]) -> str:
    named = {tag: f'{tag} "{names[tag]}"' if tag in names else str(tag) for tag in counts}
    return ", ".join(f"{named[tag]} ({n})" for tag, n in counts.items()) or "none"
