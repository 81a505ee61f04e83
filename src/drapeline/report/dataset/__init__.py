"""Figures and tables of a dataset."""
