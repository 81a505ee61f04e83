"""Codes of garments at rest from pictures of them as they are worn (CLOTH3D 5.3)."""
