"""Garment4D: garments from sequences of point clouds of a dressed person (Hong et al. 2021).

A canonical stage tells garment points from body points and finds the garment's shape; a posed
stage moves that shape, skinned to the body, onto the points of every frame.
"""
