"""Generation of samples: a body in motion, an outfit for it, its simulation, its folder."""
