"""Settings by group, as configs hold them."""

from collections.abc import Mapping
from typing import Any


def override_settings(
    settings: Mapping[str, Mapping[str, Any]], changes: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Settings with some of them replaced.

    Args:
        settings: group -> name -> value, such as {"training": {"epochs": 12}}.
        changes: likewise; groups that `settings` lacks are ignored.
    """
    return {group: {**values, **changes.get(group, {})} for group, values in settings.items()}
