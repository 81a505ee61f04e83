"""Figures and tables of Garment4D."""
