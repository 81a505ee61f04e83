"""Meshes and what is computed on them."""
