"""Figures and tables of SMPLicit."""
