"""SMPLicit: garments as distance fields around the body (Corona et al. 2021)."""
