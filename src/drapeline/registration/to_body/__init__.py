"""Garments as offsets from the body (CLOTH3D 4.1)."""
