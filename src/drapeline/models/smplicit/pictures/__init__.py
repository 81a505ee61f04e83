"""Garments in segmented pictures."""
