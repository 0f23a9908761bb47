"""Mesh sizes on meshes that are distributed over many processes."""

from adaptsize.distributed.api import limit_gradient
from adaptsize.distributed.communicator import Communicator, Traffic, as_communicator
from adaptsize.distributed.mesh import PartitionedMesh
from adaptsize.distributed.simulated import SimulatedCommunicator

__all__ = [
    "Communicator",
    "PartitionedMesh",
    "SimulatedCommunicator",
    "Traffic",
    "as_communicator",
    "limit_gradient",
]
