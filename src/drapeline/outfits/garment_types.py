"""CLOTH3D's six garment types, jackets, and the outfits that they make."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

from drapeline.errors import InputError

FITS = ("fitted", "regular", "loose")


@dataclass(frozen=True)
class GarmentType:
    """Parts and wear of the garments of a type."""

    # Of the body that they cover. Upper garments are worn over lower ones, whose waistband is held;
    # garments for the whole body are sewn together at the waist.
    region: Literal["upper", "lower", "whole"]
    skirt: bool = False  # whether they have one tube for both legs
    sleeve_chance: float = 0.0  # the probability of sleeves; without sleeves they have straps
    outer: bool = False  # whether they are open in front and worn over other garments

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts that they are cut from, from top to bottom: "upper", then "trousers" or "skirt"."""
        upper = () if self.region == "lower" else ("upper",)
        legs = () if self.region == "upper" else ("skirt" if self.skirt else "trousers",)
        return upper + legs


# Files store types as positions in this table, so new types come last.
GARMENT_TYPES = {
    "Tshirt": GarmentType("upper", sleeve_chance=1.0),
    "Top": GarmentType("upper"),
    "Trousers": GarmentType("lower"),
    "Skirt": GarmentType("lower", skirt=True),
    "Jumpsuit": GarmentType("whole", sleeve_chance=0.5),
    "Dress": GarmentType("whole", skirt=True, sleeve_chance=0.5),
    "Jacket": GarmentType("upper", sleeve_chance=1.0, outer=True),
}
GARMENTS = tuple(GARMENT_TYPES)
BODY = "Body"
LABELS = (BODY, *GARMENTS)  # the label of a point is an index into this
SKIRTS = tuple(name for name, garment_type in GARMENT_TYPES.items() if garment_type.skirt)
# Of reaches from 0.05 to 1 m, the one with which skinned dresses come nearest to simulated ones;
# skirts do not tell it from 0.5 m.
_SKIRT_REACH_M = 0.3


def weight_reach_m(garment: str) -> float:
    """Length over which the skinning weights of a type are diffused, metres.

    Weights of the nearest body vertices jump where a skirt hangs between the legs; diffused they go
    from one leg to the other without a crease.
    """
    return _SKIRT_REACH_M if garment in SKIRTS else 0.0


def removable_limbs(garments: Iterable[str]) -> str:
    """Limbs that garments certainly leave bare, a key of `bodies.animation.REMOVABLE`."""
    sleeves = any(GARMENT_TYPES[name].sleeve_chance for name in garments)
    return "hands" if sleeves else "forearms"


# Every combination of garment types that makes an outfit. Plans depend on the order.
OUTFIT_TYPES = (
    *("Tshirt+Trousers", "Tshirt+Skirt", "Top+Trousers", "Top+Skirt", "Dress", "Jumpsuit"),
    *("Tshirt+Trousers+Jacket", "Top+Trousers+Jacket", "Top+Skirt+Jacket"),
)
CLOTH3D_OUTFITS = OUTFIT_TYPES[:6]
# With this list, all of CLOTH3D's types of garments are worn equally often.
EVEN_OUTFIT_TYPES = (
    *("Tshirt+Trousers", "Dress", "Top+Skirt", "Jumpsuit"),
    *("Tshirt+Skirt", "Dress", "Top+Trousers", "Jumpsuit"),
)
# Types that Garment4D's paper has.
GARMENT4D_TYPES = ("Skirt", "Tshirt", "Trousers")
# The order in which tables have types.
TABLE_TYPES = tuple(dict.fromkeys((*GARMENT4D_TYPES, *GARMENTS)))


Item = TypeVar("Item")


def layered(garments: Iterable[str]) -> tuple[str, ...]:
    """The garments of an outfit, from the innermost to the outermost."""

    def height(name: str) -> tuple[bool, bool]:
        kind = GARMENT_TYPES[name]
        return kind.outer, kind.region != "lower"

    return tuple(sorted(garments, key=height))


def first_of_each(items: Iterable[tuple[str, Item]], types: Sequence[str] = GARMENTS) -> list[Item]:
    """The first item of each type in the order of `GARMENTS`; no more are read than needed.

    Args:
        items: with their types.
        types: that there are among them, as far as known.
    """
    found: dict[str, Item] = {}
    for garment, item in items:
        found.setdefault(garment, item)
        if len(found) == len(types):
            break
    return [found[garment] for garment in GARMENTS if garment in found]


def outfit_types_by_gender(
    outfit_types: Sequence[str], *, male_skirts: bool, males: bool
) -> dict[str, list[str]]:
    """Gender -> those of the wanted outfits that its bodies may wear, in the given order.

    Args:
        outfit_types: some of `OUTFIT_TYPES`.
        male_skirts: whether male bodies wear skirts and dresses too.
        males: whether there are male bodies at all.

    Raises:
        InputError: male bodies are left with nothing to wear.
    """
    for_males = [
        name for name in outfit_types if male_skirts or not set(SKIRTS) & set(name.split("+"))
    ]
    if males and not for_males:
        raise InputError(
            f"outfits.types is {', '.join(outfit_types)}, which leaves nothing for male bodies to"
            " wear; expected a type without a skirt, body.female_share: 1 or outfits.male_skirts:"
            " true"
        )
    return {"female": list(outfit_types), "male": for_males}


def part_of_body(garment: str) -> str:
    """What a garment type covers: "upper", "trousers", "skirt" or "whole"."""
    parts = GARMENT_TYPES[garment].parts
    return parts[0] if len(parts) == 1 else GARMENT_TYPES[garment].region
