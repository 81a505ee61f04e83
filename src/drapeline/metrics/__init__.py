"""Errors of predicted garments, and those of trivial predictions."""
