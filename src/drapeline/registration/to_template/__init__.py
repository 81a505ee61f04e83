"""Garments in the topology of their type's template (Garment4D 2.2)."""
