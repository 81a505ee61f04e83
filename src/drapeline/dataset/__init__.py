"""CLOTH3D-format datasets: writing, reading, splitting, describing."""
