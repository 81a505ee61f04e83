"""Figures and tables of the garment VAEs."""
