"""Gradient limiting: the largest h <= h0 with |grad h| <= g."""

from adaptsize.limiting.barth_sethian import PositiveCoefficient
from adaptsize.limiting.edge_based import EdgeBased
from adaptsize.limiting.exact import Exact
from adaptsize.limiting.fast_marching import FastMarching
from adaptsize.limiting.hamilton_jacobi import HamiltonJacobi
from adaptsize.limiting.limit import limit_gradient
from adaptsize.limiting.sphere import limit_on_sphere

__all__ = [
    "EdgeBased",
    "Exact",
    "FastMarching",
    "HamiltonJacobi",
    "PositiveCoefficient",
    "limit_gradient",
    "limit_on_sphere",
]
