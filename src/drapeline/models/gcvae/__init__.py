"""The garment VAEs of CLOTH3D (Bertiche et al. 2020) and ours."""
