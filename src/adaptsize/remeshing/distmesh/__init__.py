"""Mesh generation from distance functions by smoothing, after DistMesh."""
