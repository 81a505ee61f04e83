"""Sewing patterns of garments, in panels of quads."""
