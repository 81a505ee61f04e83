"""Figures and tables of registration."""
