"""Garment synthesis: templates, cuts, resizing, sewing."""
