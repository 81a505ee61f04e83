"""CLOTH3D's garment types and the outfits that they make."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

from drapeline.errors import InputError

GARMENTS = ("Tshirt", "Top", "Trousers", "Skirt", "Jumpsuit", "Dress")
# Garments whose legs hang in one tube.
SKIRTS = ("Skirt", "Dress")
# Types that Garment4D has templates of.
TEMPLATE_TYPES = ("Skirt", "Tshirt", "Trousers")
# Every combination of garment types that makes an outfit.
OUTFIT_TYPES = ("Tshirt+Trousers", "Tshirt+Skirt", "Top+Trousers", "Top+Skirt", "Dress", "Jumpsuit")


Item = TypeVar("Item")


def first_of_each(items: Iterable[tuple[str, Item]]) -> list[Item]:
    """The first item of each garment type, in the order of `GARMENTS`.

    Args:
        items: with their types, read until there is one of each.
    """
    found: dict[str, Item] = {}
    for garment, item in items:
        found.setdefault(garment, item)
        if len(found) == len(GARMENTS):
            break
    return [found[garment] for garment in GARMENTS if garment in found]


def outfit_types_by_gender(
    outfit_types: Sequence[str], *, male_skirts: bool, males: bool
) -> dict[str, list[str]]:
    """Which of the wanted outfits bodies of each gender may wear.

    Args:
        outfit_types: some of `OUTFIT_TYPES`.
        male_skirts: whether male bodies wear skirts and dresses too.
        males: whether there are male bodies at all.

    Returns:
        Gender -> outfit types, in the given order.

    Raises:
        InputError: male bodies are left with nothing to wear.
    """
    for_males = [
        name for name in outfit_types if male_skirts or not set(SKIRTS) & set(name.split("+"))
    ]
    if males and not for_males:
        raise InputError(
            f"outfits.types is {', '.join(outfit_types)}, which leaves nothing for male bodies to"
            " wear; expected a type without a skirt, or outfits.male_skirts: true"
        )
    return {"female": list(outfit_types), "male": for_males}
