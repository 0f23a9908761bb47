"""Signed distances to boundaries."""
