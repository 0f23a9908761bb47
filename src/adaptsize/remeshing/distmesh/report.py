"""The report on a mesh made by smoothing: convergence, quality, and parts it misses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from adaptsize._checks import warn_caller
from adaptsize._messages import Message
from adaptsize.background import SimplexMesh, topology
from adaptsize.errors import ConvergenceWarning, ResolutionWarning
from adaptsize.quality import size_conformity
from adaptsize.quality.conformity import Conformity
from adaptsize.quality.elements import minimum_angles
from adaptsize.remeshing.distmesh import tuning
from adaptsize.remeshing.distmesh.finish import TOLERANCE
from adaptsize.remeshing.distmesh.implicit_domain import DistanceDomain
from adaptsize.remeshing.distmesh.rejection import Sampling
from adaptsize.remeshing.distmesh.relaxation import Relaxed
from adaptsize.typing import IntArray


@dataclass(frozen=True)
class SmoothingReport:
    """How a mesh was made from a distance function, and its quality.

    Attributes
    ----------
    n_steps, n_triangulations : int
        Number of smoothing steps, and of Delaunay triangulations.
    converged : bool
        Whether the nodes converged within ``max_iter`` steps.
    last_move : float
        Mean displacement of a node in the last step, in sizes.
    conformity : Conformity
        Edge lengths over sizes, qualities and angles; see `adaptsize.size_conformity`.
    n_slivers : int
        Cells with an angle (tetrahedra: dihedral angle) below 10 degrees.
    measure, domain_measure : float
        Area or volume of the mesh, and of the domain as estimated from samples.
    boundary_residual : float
        Largest distance of a boundary node from the boundary of the domain, in sizes; inf
        where the distance function has no slope.
    boundary_gap : float
        Largest distance of the centroid of a boundary facet from the boundary of the
        domain, in sizes.  It is caused by chords and cut corners.
    n_uncovered : int
        Sample points of the domain without a node of the mesh nearby.
    n_components : int
        Components of the mesh, which have no facet in common.
    n_broken : int
        Pairs of nearby nodes of different components that a straight line inside the domain
        connects.
    fixed_nodes : int32[n]
        Node of each of ``fixed_points``, or -1 if it is in no cell.
    """

    n_steps: int
    n_triangulations: int
    converged: bool
    last_move: float
    conformity: Conformity
    n_slivers: int
    measure: float
    domain_measure: float
    boundary_residual: float
    boundary_gap: float
    n_uncovered: int
    n_components: int
    n_broken: int
    fixed_nodes: IntArray

    def __str__(self) -> str:
        """Return a small table."""
        state = "converged" if self.converged else "not converged"
        return "\n".join(
            [
                str(self.conformity),
                f"{self.n_slivers} slivers (below {tuning.SLIVER_ANGLE:g} deg), "
                f"{self.n_components} component(s), measure {self.measure:.6g} of about "
                f"{self.domain_measure:.6g}, {self.n_uncovered} samples of the domain uncovered",
                f"boundary nodes within {self.boundary_residual:.2g} sizes, facets within "
                f"{self.boundary_gap:.2g} sizes of the boundary",
                f"{self.n_steps} steps, {state} (mean move {self.last_move:.2g} sizes), "
                f"{self.n_triangulations} triangulations",
            ]
        )


def describe(
    mesh: SimplexMesh,
    domain: DistanceDomain,
    sampling: Sampling,
    relaxed: Relaxed,
    fixed_nodes: IntArray,
) -> SmoothingReport:
    """Return the report; ``fixed_nodes`` are the numbers of the fixed points, or -1."""
    from scipy.spatial import cKDTree

    skin = mesh.boundary().mesh
    free = np.setdiff1d(mesh.boundary().nodes, fixed_nodes)
    at, h = mesh.points[free], domain.size(mesh.points[free])
    phi = domain.phi(at)
    residual = np.linalg.norm(domain.newton_steps(at, phi, h), axis=1) / h
    is_zero = np.abs(phi) <= TOLERANCE * domain.slope * h
    residual[(residual == 0.0) & ~is_zero] = np.inf  # unknown without a slope
    centres = skin.points[skin.cells].mean(axis=1)
    h = domain.size(centres)
    gap = np.linalg.norm(domain.newton_steps(centres, domain.phi(centres), h), axis=1) / h
    far = cKDTree(mesh.points).query(sampling.probes)[0] > tuning.UNCOVERED * domain.size(
        sampling.probes
    )
    # Components have no facet in common.
    links = topology.pairs_of_cells(mesh, mesh.facet_cell_counts == 2) // mesh.cells.shape[1]
    component = topology.components_of(links, mesh.n_cells)
    return SmoothingReport(
        n_steps=relaxed.n_steps,
        n_triangulations=relaxed.n_triangulations,
        converged=relaxed.converged,
        last_move=relaxed.last_move,
        conformity=size_conformity(mesh, domain.size),
        n_slivers=int(np.count_nonzero(minimum_angles(mesh) < tuning.SLIVER_ANGLE)),
        measure=float(mesh.measures.sum()),
        domain_measure=sampling.measure,
        boundary_residual=float(residual.max(initial=0.0)),
        boundary_gap=float(gap.max(initial=0.0)),
        n_uncovered=int(np.count_nonzero(far)),
        n_components=int(component.max()) + 1,
        n_broken=_n_broken(mesh, component, domain),
        fixed_nodes=fixed_nodes,
    )


def _n_broken(mesh: SimplexMesh, component: npt.NDArray[np.integer], domain: DistanceDomain) -> int:
    """Return how many pairs of nearby nodes of different components the domain connects."""
    from scipy.spatial import Delaunay

    if component.max() == 0:
        return 0
    part = np.full(mesh.n_points, -1)
    part[mesh.cells] = component[:, None]
    edges = topology.edges_of(Delaunay(mesh.points).simplices.astype(np.int32), mesh.n_points)
    a, b = mesh.points[edges].transpose(1, 0, 2)
    near = np.linalg.norm(a - b, axis=1) < tuning.NEAR_COMPONENTS * domain.size(0.5 * (a + b))
    pairs = near & (part[edges[:, 0]] != part[edges[:, 1]])
    a, b = a[pairs], b[pairs]
    visible = np.ones(len(a), np.bool_)
    for t in np.linspace(0.1, 0.9, 9):
        visible &= domain.phi(a + t * (b - a)) < 0.0
    return int(np.count_nonzero(visible))


def warn_of_faults(report: SmoothingReport) -> None:
    """Warn of a mesh that has not converged or does not resolve its domain."""
    if not report.converged and report.last_move > tuning.STILL_MOVING:
        warn_caller(
            Message(
                "nodes still moved by {:.2g} sizes per step after {} steps; raise {max_iter}, or "
                "limit the gradient of the sizes",
                *(report.last_move, report.n_steps),
            ),
            ConvergenceWarning,
        )
    faults = []
    if report.n_uncovered:
        faults.append(f"{report.n_uncovered} samples of the domain have no node nearby")
    if report.n_broken:
        faults.append(
            f"its {report.n_components} components are connected in the domain (at "
            f"{report.n_broken} places), which is narrow there"
        )
    share = report.measure / report.domain_measure
    if abs(share - 1.0) > tuning.MEASURE_OFF:
        faults.append(f"its measure is {share:.1%} of that of the domain")
    if report.n_slivers:
        faults.append(
            f"it has {report.n_slivers} slivers, smallest angle "
            f"{report.conformity.angle_min:.2g} degrees"
        )
    if report.boundary_residual > tuning.RESIDUAL:
        faults.append(
            f"its boundary nodes are up to {report.boundary_residual:.2g} sizes from the boundary "
            "of the domain (inf: distance has no slope there)"
        )
    lost = int(np.count_nonzero(report.fixed_nodes < 0))
    if lost:
        faults.append(f"{lost} fixed points are in no cell")
    if faults:
        warn_caller(
            f"the mesh does not resolve the domain well: {'; '.join(faults)}; "
            "use smaller sizes, or pass corners as fixed_points",
            ResolutionWarning,
        )
