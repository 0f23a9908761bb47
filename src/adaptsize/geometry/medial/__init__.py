"""Medial axes, inscribed spheres and feature sizes."""
