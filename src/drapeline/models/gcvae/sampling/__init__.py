"""New garments from a trained static VAE."""
