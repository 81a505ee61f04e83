"""Cloth on a moving body: attempts, transitions, collider and health, over any cloth solver."""
