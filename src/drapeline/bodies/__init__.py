"""Bodies: baking, loading, posing, self-collision."""
