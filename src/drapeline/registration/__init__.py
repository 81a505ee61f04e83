"""Garments as offsets from the body: the body's surface, its topologies and hierarchy."""
