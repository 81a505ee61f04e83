"""Colours of all figures and renderings; most of what draws them does without Matplotlib."""

# Okabe and Ito's palette, which colour-blind readers can tell apart.
BLUE, ORANGE, GREEN, PURPLE = "#0072B2", "#E69F00", "#009E73", "#CC79A7"
VERMILION, SKY = "#D55E00", "#56B4E9"
INK, QUIET, FAINT = "#222222", "#6b6f76", "#e3e5e8"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, VERMILION, SKY)
GENDER_COLOURS = {"female": PURPLE, "male": BLUE}
GARMENT_COLOURS = {
    "Tshirt": BLUE,
    "Top": ORANGE,
    "Trousers": GREEN,
    "Skirt": PURPLE,
    "Jumpsuit": VERMILION,
    "Dress": SKY,
    "Jacket": "#7A5C3E",
}
# The others have no highlights.
FABRIC_GLOSS = {
    "silk": 0.22,
    "satin": 0.35,
    "leather": 0.3,
    "nylon_shell": 0.2,
    "blender_silk": 0.22,
    "blender_leather": 0.3,
}
# Blender's presets have the colours of the fabrics that they are called after.
FABRIC_COLOURS = {
    "cotton": SKY,
    "linen": "#D9C9A3",
    "denim": BLUE,
    "silk": ORANGE,
    "satin": PURPLE,
    "wool_suiting": INK,
    "jersey": GREEN,
    "fleece": "#8FD0B5",
    "leather": VERMILION,
    "nylon_shell": "#F0E442",
    "blender_cotton": SKY,
    "blender_silk": ORANGE,
    "blender_denim": BLUE,
    "blender_leather": VERMILION,
}


def garment_colour(garment: str) -> tuple[float, float, float]:
    """sRGB of a garment type in 0-1, the same in every figure."""
    red, green, blue = bytes.fromhex(GARMENT_COLOURS[garment].removeprefix("#"))
    return red / 255, green / 255, blue / 255


def fabric_gloss(fabric: str | None) -> float:
    """Strength of a fabric's highlights in renderings, 0 for none."""
    return FABRIC_GLOSS.get(fabric or "", 0.0)
