"""Keys that settings had once: each is refused with the name that it has now."""

from collections.abc import Iterator, Mapping
from typing import Any

from drapeline.errors import InputError

_GROUP = ("count", "shard_size", "val_share", "test_share", "solver")
_MOTIONS = ("sequences", "loop_frames", "frames", "frames_min", "speeds", "mirror")


def _of_group(group: str) -> dict[str, str]:
    return {
        **{key: f"groups.{group}.{key}" for key in _GROUP},
        **{key: f"groups.{group}.motions.{key}" for key in _MOTIONS},
        **{key: f"groups.{group}.outfits.{key}" for key in ("types", "edge_length_m")},
        "attempts": f"groups.{group}.simulation.attempts",
        "settle_frames": f"groups.{group}.outfits.hang_frames",
    }


_MOVED = {
    **{
        f"{old}.{key}": new
        for old, group in (("samples", "dataset"), ("learning", "learning"), ("static", "static"))
        for key, new in _of_group(group).items()
    },
    "samples": "groups.dataset",
    "learning": "groups.learning",
    "static": "groups.static",
    "scans.learning": "scans.count",
    "scans.samples": "scans.noisy",
    "smplicit.evaluate_images.learning": "smplicit.evaluate_images.others",
}


def refuse_old_keys(settings: Mapping[str, Any], source: str) -> None:
    """Check that no key is one that has another name now.

    Args:
        settings: nested mappings as read from YAML.
        source: name of the file they come from, for the message.

    Raises:
        InputError: names the first such key, the longest way into it, and its new name.
    """
    for key in _keys(settings):
        if key in _MOVED:
            raise InputError(f"{source}: '{key}' is called {_MOVED[key]} now")


def _keys(settings: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Dotted keys of all settings, those within a mapping before its own."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _keys(value, f"{prefix}{name}.")
        yield f"{prefix}{name}"
