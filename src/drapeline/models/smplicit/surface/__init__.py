"""The surface of a garment's distance field."""
