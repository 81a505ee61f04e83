"""Figures and tables of the models."""
