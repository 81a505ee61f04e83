"""Garment synthesis: templates, cuts, resizing, sewing (CLOTH3D 3.2)."""
