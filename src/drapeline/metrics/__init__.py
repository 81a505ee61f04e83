"""How good predicted garments are, and what trivial predictions reach."""
