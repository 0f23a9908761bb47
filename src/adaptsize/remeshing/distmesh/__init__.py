"""Meshes from distance functions by smoothing, after DistMesh."""
