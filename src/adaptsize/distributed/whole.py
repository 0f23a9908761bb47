"""Properties of the whole mesh that need all its parts."""

from __future__ import annotations

import numpy as np

from adaptsize.adaptation.next_sizes import NextSizes, Present, edge_weights
from adaptsize.background import SimplexMesh
from adaptsize.background.migration import boundary_facets
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.typing import BoolArray


def total_measure(part: PartitionedMesh) -> float:
    """Return the area or volume of the mesh; collective."""
    own = 0.0 if part.mesh is None else float(part.mesh.measures.sum())
    return float(part.ranks.allreduce(own, "sum"))


def lost_tags(old: PartitionedMesh, new: PartitionedMesh) -> tuple[str, ...]:
    """Return the tags of cells and facets of the old mesh that the new one lacks; collective."""
    before, after = (set().union(*part.ranks.allgather(_tags(part))) for part in (old, new))
    return tuple(f"{kind} tag {tag}" for kind, tag in sorted(before - after))


def _tags(part: PartitionedMesh) -> set[tuple[str, int]]:
    found: set[tuple[str, int]] = set()
    for kind in ("cell", "facet"):
        tags = None if part.mesh is None else getattr(part.mesh, f"{kind}_tags")
        if tags is not None:
            found |= {(kind, tag) for tag in np.unique(tags).tolist()}
    return found


def boundary_distance(old: PartitionedMesh, new: PartitionedMesh) -> float:
    """Return the largest distance of a boundary node of a mesh to the boundary of another one.

    Collective.  All ranks get the boundary of the old mesh.
    """
    corners = np.concatenate(old.ranks.allgather(old.points[boundary_facets(old)]))
    nodes = np.unique(boundary_facets(new))
    rows = np.arange(corners.shape[0] * corners.shape[1]).reshape(corners.shape[:2])
    skin = SimplexMesh(corners.reshape(-1, old.dim), rows)
    own = float(skin.locator.nearest(new.points[nodes])[2].max()) if len(nodes) else 0.0
    return float(old.ranks.allreduce(own, "max"))


def compare_with(part: PartitionedMesh, sizes: NextSizes) -> Present:
    """Return how the mesh compares with the next sizes; collective."""
    weights, longest = np.zeros(3), 0.0
    counted = _counted_edges(part)
    if part.mesh is not None:
        pieces = sizes.pieces(part.mesh)
        weights, longest = edge_weights(pieces[counted], part.cell_dim), float(pieces.max())
    return Present(
        part.n_global_cells,
        part.ranks.allreduce(weights, "sum"),
        float(part.ranks.allreduce(longest, "max")),
    )


def _counted_edges(part: PartitionedMesh) -> BoolArray:
    """Return whether this rank is the lowest one that has each of its edges; one exchange."""
    comm = part.ranks
    edges = np.empty((0, 2), np.int32) if part.mesh is None else part.mesh.edges
    low, high = np.sort(part.global_ids[edges], axis=1).T
    keys = low * part.n_global_points + high
    sent = []
    for rank, nodes in enumerate(part.shared.nodes):
        held = np.zeros(part.n_points, np.bool_)
        held[nodes] = rank > comm.rank
        sent.append(keys[held[edges].all(axis=1)])
    return np.isin(keys, np.concatenate(comm.alltoallv(sent)), invert=True)
