"""A fast cloth solver: extended position-based dynamics in small steps, by Warp."""
