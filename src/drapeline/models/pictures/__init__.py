"""Pictures of dressed people: a user's, and those of simulated samples, for any model."""
