"""The functions, and the kinds of domains, that have options."""

from collections.abc import Mapping, Sequence

from adaptsize.options.loops import AdaptOptions
from adaptsize.options.meshes import (
    DistanceOptions,
    FamilyOptions,
    ImageMeshOptions,
    RemeshOptions,
    RemeshToElementsOptions,
)
from adaptsize.options.records import options_of
from adaptsize.options.sizes import (
    FunctionSizeOptions,
    ImageSizeOptions,
    MeshSizeOptions,
    SizeFunctionOptions,
)

#: The options that `size_function` implements, by the kind of domain.
DOMAINS: Mapping[str, type] = {
    "meshes": MeshSizeOptions,
    "implicit functions": FunctionSizeOptions,
    "images": ImageSizeOptions,
}


#: The options of the functions that make sizes or meshes.  `with_options` has the others.
ENTRANCES: Mapping[str, type] = {
    "size_function": SizeFunctionOptions,
    "remesh": RemeshOptions,
    "remesh_to_elements": RemeshToElementsOptions,
    "mesh_family": FamilyOptions,
    "mesh_image": ImageMeshOptions,
    "mesh_from_distance": DistanceOptions,
    "adapt": AdaptOptions,
}
#: Arguments of `remesh_to_elements` that other functions have as options.
_ARGUMENTS = {"remesh_to_elements": ("elements", "nodes")}


def entrances_with(name: str, entrances: Mapping[str, type]) -> str:
    """Return in words which entrances have an option; empty if none has it.

    Examples
    --------
    >>> entrances_with("spacing", ENTRANCES)
    'size_function and mesh_image'
    """
    return joined(
        [
            title
            for title, record in entrances.items()
            if name in (*options_of(record), *_ARGUMENTS.get(title, ()))
        ]
    )


def joined(names: Sequence[str]) -> str:
    """Return names in one phrase."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
