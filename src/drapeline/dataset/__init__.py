"""CLOTH3D-format datasets: write, read, split and describe them."""
