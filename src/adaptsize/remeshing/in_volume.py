"""Sizes in a first volume: from the surface, and from sources inside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.bisection import resolved
from adaptsize.limiting import limit_gradient
from adaptsize.limiting.inside import SolidField
from adaptsize.remeshing import tuning
from adaptsize.remeshing.preparation import Frame, as_problem
from adaptsize.remeshing.protocol import MeshingProblem
from adaptsize.typing import FloatArray


def in_volume(
    problem: MeshingProblem, field: SolidField, frame: Frame, limit: float
) -> MeshingProblem:
    """Return the request to adapt a first volume, with sizes that are limited in it.

    Its cells are bisected until no source inside is missed.  The sizes are those that are seen
    from each point (see `SolidField`).  If the best source is hidden somewhere, sizes are limited
    in the volume from these on, so that they grow around corners.

    Parameters
    ----------
    problem : MeshingProblem
        Tetrahedra in the surface, in coordinates of their own.
    field : SolidField
        What the sizes on the surface, and sources inside, allow.
    frame : Frame
        Of these coordinates.
    limit : float
        Upper limit of the sizes.
    """
    g = field.g

    def at_most(points: FloatArray) -> FloatArray:
        return np.full(len(points), limit)

    given = problem.mesh.moved(frame.from_own(problem.mesh.points))
    sources, ridges = field.inner.sources, problem.ridges
    if sources:
        found = resolved(
            given, lambda x: field.of_inner_sources(x, at_most(x)),
            g=g if all(source.is_graded for source in sources) else None,
            samples=np.concatenate([source.samples for source in sources]),
            curves=ridges, max_points=tuning.MOST_NODES_OF_VOLUME,
        )  # fmt: skip
        if found.mesh is not given:
            given, ridges = found.mesh, found.curves if len(ridges) else ridges
            mesh = given.moved(frame.to_own(given.points))
            plain = as_problem("tetrahedra", mesh, problem.tolerance / mesh.diagonal)
            problem = replace(
                problem, mesh=mesh, facets=plain.facets, regions=plain.regions, ridges=ridges
            )
    values = _limited_in(given, field, at_most(given.points), g)
    if values is None:
        return problem
    everywhere = not all(source.is_graded for source in sources)

    def there(points: FloatArray) -> FloatArray:
        places = frame.from_own(points)
        sizes, hidden = field.with_hidden(places, at_most(places))
        hidden = np.arange(len(places)) if everywhere else hidden
        between = given.locator.interpolate(values, places[hidden])[0]
        sizes[hidden] = np.minimum(sizes[hidden], between)
        return sizes / frame.scale

    return replace(problem, size=there)


def _limited_in(
    mesh: SimplexMesh, field: SolidField, bound: FloatArray, g: float
) -> FloatArray | None:
    """Return the sizes at the nodes of a volume, limited in it; None if they need no limiting."""
    sizes = field.evaluate(mesh.points, bound)
    ends = sizes[mesh.edges]
    rise = np.abs(ends[:, 1] - ends[:, 0]) - g * mesh.edge_lengths
    if (rise <= tuning.STEEP * ends.min(axis=1)).all():
        return None
    return np.asarray(limit_gradient(mesh, sizes, g, method="fast-marching"))
