"""Radii of inscribed spheres and their bounds."""

import numpy as np

from adaptsize.geometry import inscribed_spheres

# What the descent may leave undone: 1 / 0.99.
EXCESS = 1.0102


def sagitta(mesh, radius):
    """How far the middles of the longest edges lie inside a surface of that radius."""
    return radius - np.sqrt(radius**2 - 0.25 * mesh.edge_lengths.max() ** 2)


def assert_radii(radii, exact, low=1.0, high=EXCESS):
    ratio = radii / exact
    assert (ratio >= low - 1e-9).all(), f"smallest {ratio.min()}, wanted {low}"
    assert (ratio <= high + 1e-9).all(), f"largest {ratio.max()}, wanted {high}"


def smallest(boundary, points=None, **options):
    return inscribed_spheres(boundary, points, **options).smallest()
