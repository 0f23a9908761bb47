"""Gradient limiting on meshes in parts."""
