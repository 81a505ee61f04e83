"""Cloth simulation settings and the health of its results; no Blender here."""
