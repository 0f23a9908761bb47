"""Medial axes and feature sizes."""
