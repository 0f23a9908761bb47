"""The functions that place nodes on the true boundary, as they are given and checked."""

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe
from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray

#: Takes points near the boundary, float64[n, dim], and returns their projections onto it.
BoundaryMap: TypeAlias = Callable[[FloatArray], npt.ArrayLike]
BoundaryMapLike: TypeAlias = BoundaryMap | Mapping[int | str, BoundaryMap]
#: A projection for all of the boundary, or for facets by tag.
BoundaryMaps: TypeAlias = BoundaryMap | Mapping[int, BoundaryMap]


def as_boundary_maps(project: object, mesh: SimplexMesh) -> BoundaryMaps | None:
    """Return a projection, or projections by the tags of facets that the mesh has.

    Raises
    ------
    ValueError
        Unless ``project`` is None, a callable, or maps such tags or their names to callables, each
        tag to one.
    """
    if project is None or callable(project):
        return project
    if not isinstance(project, Mapping) or not _is_by_tag(project):
        raise ValueError(
            "project must be a callable that takes and returns points, or a mapping of tags of "
            f"facets, or their names, to callables, got {describe(project)}"
        )
    held = set() if mesh.facet_tags is None else set(np.unique(mesh.facet_tags).tolist())
    name_of = {tag: mesh.tag_names.get((mesh.cell_dim - 1, tag)) for tag in sorted(held)}
    found: dict[int, BoundaryMap] = {}
    for key, projection in project.items():
        tags = [tag for tag, name in name_of.items() if key in (tag, name)]
        if not tags:
            known = [f"{t} ({n!r})" if n else str(t) for t, n in name_of.items()]
            raise ValueError(
                f"project must be for tags of facets of the mesh ({', '.join(known) or 'none'}), "
                f"got {key!r}"
            )
        twice = [tag for tag in tags if tag in found]
        if twice:
            raise ValueError(
                f"project must have one function for each tag, got two for {twice[0]} "
                f"({name_of[twice[0]]!r}): one by its number and one by its name"
            )
        found |= dict.fromkeys(tags, projection)
    return found


def _is_by_tag(project: Mapping[Any, Any]) -> bool:
    """Return whether a mapping has a function for one or more tags or names."""
    are_tags = all(isinstance(tag, int | np.integer | str) for tag in project)
    return len(project) > 0 and are_tags and all(map(callable, project.values()))
