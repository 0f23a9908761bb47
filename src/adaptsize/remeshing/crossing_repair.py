"""Repair of an adapted surface in the few places where its facets cross.

Mmg leaves single nodes off the given surface, by less than the tolerance.  Where a wall is thinner
than that, or facets are narrow beside a feature edge, the facets there cross others.  These nodes
are moved onto the given surface.  Where this is not enough, short edges around are collapsed.
Nothing else of the surface changes.
"""

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.topology import marked
from adaptsize.geometry.boundary import facet_normals
from adaptsize.geometry.enclosed import is_oriented
from adaptsize.quality.boundary import farthest_places
from adaptsize.quality.certificate import NEAR
from adaptsize.remeshing import tuning
from adaptsize.remeshing.crossings import crossing_facets
from adaptsize.remeshing.surface import remove_slivers
from adaptsize.remeshing.taken_back import move_nodes
from adaptsize.typing import BoolArray, IntArray


def repair_crossings(
    surface: SimplexMesh, given: SimplexMesh, tolerance: float
) -> tuple[SimplexMesh, IntArray]:
    """Return an adapted surface whose facets do not cross, and the new node for each node.

    It is ``surface`` itself if that has no crossing facets, or if the repair fails: then facets
    still cross, the surface would not be closed, or it would be farther from the given one than the
    tolerance and than before.

    Parameters
    ----------
    surface : SimplexMesh
        Closed, with edges of the requested lengths.
    given : SimplexMesh
        What it was made of.
    tolerance : float
        Allowed distance between both, in the unit of the coordinates.
    """
    same = np.arange(surface.n_points, dtype=np.int32)
    new, new_node, changed = surface, same, np.zeros(surface.n_points, np.bool_)
    for share in (0.0, *tuning.COLLAPSED_AT_CROSSINGS):
        nodes, where = _nodes_at_crossings(new)
        if not len(nodes):
            break
        changed |= where[new_node]
        if share > 0.0:
            new, step = remove_slivers(new, share * tolerance, where)
            new_node, nodes = step[new_node], np.unique(step[nodes])
        new = _on_given(new, nodes, given, tolerance)
    if new is surface or len(_nodes_at_crossings(new)[0]) or not is_oriented(new):
        return surface, same
    after = new, marked(new_node[changed], new.n_points)
    return (
        (new, new_node)
        if _is_near((surface, changed), after, given, tolerance)
        else (surface, same)
    )


def _nodes_at_crossings(surface: SimplexMesh) -> tuple[IntArray, BoolArray]:
    """Return the nodes of the facets that cross, and which nodes are in the rings around them."""
    found = crossing_facets(surface, tuning.SLACK_OF_ADAPTED)
    nodes = np.unique(surface.cells[np.concatenate([found.cells, found.others])])
    where = marked(nodes, surface.n_points)
    for _ in range(tuning.RINGS_AT_CROSSINGS):
        where = marked(surface.cells[where[surface.cells].any(axis=1)], surface.n_points)
    return nodes, where


def _on_given(
    surface: SimplexMesh, nodes: IntArray, given: SimplexMesh, tolerance: float
) -> SimplexMesh:
    """Return the surface with nodes on the given one, where no triangle becomes flat or turns.

    They are moved to the nearest facets that face the same way: the other side of a wall thinner
    than the tolerance may be nearer.
    """
    points, there = surface.points.copy(), surface.points[nodes]
    of_node, near = given.locator.within(there, given.locator.nearest(there)[2] + tolerance)
    faces = facet_normals(given.points[given.cells])
    normals = np.zeros_like(points)
    np.add.at(normals, surface.cells, facet_normals(points[surface.cells])[:, None])
    for k, node in enumerate(nodes.tolist()):
        rows = near[of_node == k]
        rows = rows[faces[rows] @ normals[node] > 0.0]
        if len(rows):
            side = SimplexMesh(given.points, given.cells[rows])
            cells, weights, _ = side.locator.nearest(there[k : k + 1])
            there[k] = weights[0] @ side.points[side.cells[cells[0]]]
    move_nodes(points, surface.cells, nodes, there, tuning.QUALITY_AT_CROSSINGS)
    return surface.moved(points)


def _is_near(
    before: tuple[SimplexMesh, BoolArray],
    after: tuple[SimplexMesh, BoolArray],
    given: SimplexMesh,
    tolerance: float,
) -> bool:
    """Return whether a changed part keeps the tolerance, or is no farther away than it was.

    This is for both directions: from its facets, and from each of the given ones around.  What is
    farther away than the tolerance is brought nearer in the volume, see `improvement`.  Surfaces
    come with their nodes where something may have changed.
    """
    parts = [
        SimplexMesh(mesh.points, mesh.cells[where[mesh.cells].any(axis=1)])
        for mesh, where in (before, after)
    ]
    corners = parts[0].points[parts[0].cells]
    centres = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1) + tolerance
    near = np.unique(given.locator.within(centres, reach)[1])
    around = SimplexMesh(given.points, given.cells[near])
    (old, new), (lost, missed) = (
        [farthest_places(one, other, tolerance).distance for one, other in pairs]
        for pairs in (
            ((parts[0], given), (parts[1], given)),
            ((around, before[0]), (around, after[0])),
        )
    )
    most = 1.0 + NEAR
    return bool(
        new.max() <= most * max(tolerance, old.max())
        and (missed <= most * np.maximum(tolerance, lost)).all()
    )
