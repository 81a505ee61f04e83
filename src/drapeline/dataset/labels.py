"""What a mesh of a sample, or a point of its clouds, is part of."""

from drapeline.outfits.garment_types import GARMENTS

BODY = "Body"
LABELS = (BODY, *GARMENTS)  # a point's label is an index into it
