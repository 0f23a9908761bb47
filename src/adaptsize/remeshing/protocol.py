"""The interface between ``remesh`` and the adapters to mesh generators."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize.typing import FloatArray, IntArray

if TYPE_CHECKING:  # the child processes do not need the mesh classes
    from adaptsize.background import SimplexMesh
    from adaptsize.metrics import Metric
    from adaptsize.quality.by_place import RequestedElements
    from adaptsize.remeshing.isolation import IsolatedRunner
    from adaptsize.remeshing.sizing import MetricAt

#: The task: fill a surface with tetrahedra, or remesh with the same kind of cells.
Task: TypeAlias = Literal["surface to tetrahedra", "tetrahedra", "plane triangles", "surface"]
#: The task for cells of a dimension, in space or in the plane, and the kind of the new cells.
TASKS: Mapping[tuple[int, int, str], Task] = {
    (3, 3, "tetrahedra"): "tetrahedra",
    (2, 2, "triangles"): "plane triangles",
    (2, 3, "triangles"): "surface",
    (2, 3, "tetrahedra"): "surface to tetrahedra",
}
Arrays: TypeAlias = Mapping[str, npt.NDArray[Any]]


class Made(dict[str, npt.NDArray[Any]]):
    """The arrays of a mesh that a generator has made, and this mesh, whose topology is kept."""

    @cached_property
    def mesh(self) -> SimplexMesh:
        """The mesh of the points and cells."""
        from adaptsize.background import SimplexMesh

        return SimplexMesh(self["points"], self["cells"])


def mesh_of(arrays: Arrays) -> SimplexMesh:
    """Return the mesh of points and cells."""
    return (arrays if isinstance(arrays, Made) else Made(arrays)).mesh


class Program(NamedTuple):
    """A program that reads and writes files in its working folder."""

    write: Callable[[Path, Arrays, Mapping[str, Any]], list[str]]
    """Writes the files for arrays and options into a folder, and returns the command."""
    result: str
    """Name of the file that the program writes."""
    read: Callable[[Path, Mapping[str, Any]], dict[str, npt.NDArray[Any]]]
    """Returns the arrays in this file."""


class Facets(NamedTuple):
    """The facets that a generator must preserve, in groups that stay separate; none by default."""

    nodes: IntArray = np.empty((0, 2), np.int32)
    """int32[n, cell_dim], rows sorted: boundary, interfaces, tagged, required."""
    groups: IntArray = np.empty(0, np.int32)
    """int32[n]: 0, 1, ...  Facets of one group have the same tag and adjacent regions, and all or
    none are required."""
    required: npt.NDArray[np.bool_] = np.empty(0, np.bool_)
    """bool[n]: which of them must not change."""
    tag_of_group: npt.NDArray[np.int64] = np.empty(0, np.int64)
    """Tag of each group; ``NO_TAG`` for facets without one."""
    has_free: bool = False
    """Whether some facets lie inside one region."""


class Enclosing(NamedTuple):
    """What a surface encloses whose facets cross, where a generator alone would not tell."""

    bounding: npt.NDArray[np.bool_]
    """bool[n_cells]: the facets of which a part bounds the solid."""
    contains: Callable[[FloatArray], npt.NDArray[np.bool_]]
    """Returns which points, float64[n, 3], are inside."""


#: Packages that were found, each with the function that did so.
_INSTALLED: set[tuple[str, Callable[[str], object]]] = set()

#: Marks facets without a tag.  It is outside int32, so it cannot equal a tag.
NO_TAG = np.int64(2) ** 40


@dataclass(frozen=True)
class MeshingProblem:
    """One request to a generator, after checks and repairs.

    Attributes
    ----------
    task : str
    mesh : SimplexMesh
        Every node is used; cells of full dimension have positive measure.
    tolerance : float
        Allowed distance of the new boundary from the old one, in the unit of the coordinates.
    facets : Facets
        All facets to preserve.
    regions : int32[n_cells]
        Region of each cell, 0, 1, ...
    region_tags : int[n]
        Tag of each region.
    size : callable or None
        Requested edge length at float64[n, dim] points, as float64[n], finite and positive.
        None selects the generator's default (for a first mesh that carries the sizes).
    nodal_sizes : float64[n_points] or None
        The sizes at the nodes of the mesh, if they are given there.
    size_nodes : float64[n, dim]
        Points between which the size function interpolates.  May be empty.
    metric : callable or None
        Requested `Metric` at float64[n, dim] points, with finite sizes.  None if the sizes do not
        depend on the direction.  With a metric, ``size`` is the geometric mean of its sizes.
    metric_mesh : SimplexMesh or None
        The mesh at whose nodes the metric is given.  None if it is a function.
    ridges : int32[n, 2]
        Edges of the boundary that must stay sharp, beside those that the generator detects.
    is_adapted : bool
        Whether the boundary of the mesh has the requested edge lengths already.
    in_volume : callable or None
        Takes the request to adapt a first volume in the surface, and returns it with the sizes as
        they grow inside.
    enclosing : Enclosing or None
        If facets of a surface to be filled cross, and the boundary of the union is not known.
    is_rough : bool
        Whether the surface was rough, and still has sharp edges that are closer than the sizes.
    served : list of (SimplexMesh, RequestedElements)
        Meshes that a generator has made for the metric, and how these serve it.
    """

    task: Task
    mesh: SimplexMesh
    tolerance: float
    facets: Facets
    regions: IntArray
    region_tags: IntArray
    size: Callable[[FloatArray], FloatArray] | None = None
    nodal_sizes: FloatArray | None = None
    size_nodes: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    metric: MetricAt | None = None
    metric_mesh: SimplexMesh | None = None
    ridges: IntArray = field(default_factory=lambda: np.empty((0, 2), np.int32))
    is_adapted: bool = False
    in_volume: Callable[[MeshingProblem], MeshingProblem] | None = None
    enclosing: Enclosing | None = None
    is_rough: bool = False
    served: list[tuple[SimplexMesh, RequestedElements]] = field(default_factory=list)

    @property
    def sizes(self) -> Callable[[FloatArray], FloatArray]:
        """The requested edge lengths, of a request that has some."""
        if self.size is None:
            raise ValueError("the request has no sizes")
        return self.size

    @property
    def directions(self) -> MetricAt:
        """The requested metric, of a request that has one."""
        if self.metric is None:
            raise ValueError("the request has no metric")
        return self.metric

    @cached_property
    def metric_at_nodes(self) -> Metric:
        """The requested metric at the nodes of the mesh."""
        return self.directions(self.mesh.points)

    @cached_property
    def sizes_at_nodes(self) -> FloatArray:
        """The requested edge lengths at the nodes of the mesh, with a metric their means."""
        from adaptsize.remeshing.sizing import mean_of

        if self.nodal_sizes is not None:
            return self.nodal_sizes
        if self.metric is None:
            return self.sizes(self.mesh.points)
        return mean_of(self.metric_at_nodes, self.mesh.cell_dim)


def is_installed(package: str, find: Callable[[str], object]) -> bool:
    """Return whether a package can be imported; once found, it is not searched for again."""
    if (package, find) not in _INSTALLED and find(package) is not None:
        _INSTALLED.add((package, find))
    return (package, find) in _INSTALLED


class Backend(Protocol):
    """An adapter to one mesh generator: a class with these attributes and the method ``solve``.

    It disables the generator's gradation and its own sizes, and passes the sizes in the
    form that the generator follows.  It calls the generator only through ``run``, in child
    processes, so the generator cannot affect the caller.

    Attributes
    ----------
    name : str
        Name for ``remesh(backend=...)``.
    package : str
        Name of the Python package that must be importable.
    install : str
        The command line that installs the generator.
    tasks : frozenset of str
        Supported tasks.
    keeps_required_facets : bool
        Whether it can keep given facets unchanged.
    needs_volume : bool
        Whether it fills a surface only with a first volume mesh from another generator.
    follows_metrics : bool
        Whether it uses ``MeshingProblem.metric``.
    """

    name: str
    package: str
    install: str
    tasks: frozenset[Task]
    keeps_required_facets: bool = False
    needs_volume: bool = False
    follows_metrics: bool = False

    @property
    def installed(self) -> bool:
        """Whether the package can be imported."""
        return is_installed(self.package, find_spec)

    def solve(self, problem: MeshingProblem, run: IsolatedRunner) -> Arrays:
        """Return the new mesh, which is checked by the caller.

        Parameters
        ----------
        problem : MeshingProblem
        run : callable
            Runs a function of arrays, ``"module:name"``, or a `Program` in a child process.

        Returns
        -------
        mapping of str to array
            ``points``, float64[n_points, dim], and ``cells``, int32[n_cells, k + 1].  If the
            generator preserves them also ``regions``, int32[n_cells], ``facets``, int32[n, k],
            and ``facet_groups``, int32[n], numbered as in ``problem``.
        """
        ...
