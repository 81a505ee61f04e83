"""Labels of the meshes and points of a sample: the body or a garment type."""

from drapeline.outfits.garment_types import GARMENTS

BODY = "Body"
LABELS = (BODY, *GARMENTS)  # the label of a point is an index into this
