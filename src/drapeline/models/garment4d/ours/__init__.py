"""Our model of garments in point clouds: labels learned, shapes by regression, the rest by physics.

It is compared with Garment4D's networks on the same sequences and is no part of the paper.
"""
