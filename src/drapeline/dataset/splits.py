"""Split samples for training, validation and testing without sharing motion clips or bodies."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

SPLITS = ("train", "val", "test")


class SplitItem(NamedTuple):
    """What determines which samples must be in the same split.

    Attributes:
        sample: the sample's id.
        source: the clip that its motion was cut from.
        body: name of its body; samples with the same body shape have the same name.
    """

    sample: str
    source: str
    body: str


def split_samples(
    rng: np.random.Generator,
    items: Sequence[SplitItem],
    *,
    val_share: float,
    test_share: float,
    known: Mapping[str, str] | None = None,
) -> dict[str, str]:
    """Assign every sample to a split, before anything is generated.

    CLOTH3D was split by sequence, so that parts of the same clip are in several splits. Here
    samples that share a clip or a body, directly or through other samples, form a group that is
    never divided. Test first, and then validation, takes the groups whose sizes add up closest to
    its share. With three groups or more, no split with a positive share stays empty.

    Args:
        rng: shuffles the groups.
        items: every sample once.
        val_share: share of the samples for validation, 0 to 1.
        test_share: share of the samples for testing, 0 to 1.
        known: clip -> its split, where other samples have decided on it. The remaining clips fill
            the shares.

    Returns:
        Sample id -> "train", "val" or "test", in the order of `items`.
    """
    known = known or {}
    split_of = {item.sample: known.get(item.source, "train") for item in items}
    decided = {item.sample for item in items if item.source in known}
    groups = [group for group in _groups(items) if decided.isdisjoint(group)]
    groups = [groups[i] for i in rng.permutation(len(groups))]
    shares = [(name, share) for name, share in (("test", test_share), ("val", val_share)) if share]
    for position, (name, share) in enumerate(shares):
        others = len(shares) - position  # groups to leave for the remaining splits and train
        filled = sum(split_of[sample] == name for sample in decided)
        if filled >= share * len(items):
            continue
        chosen = _closest_sum(
            [len(group) for group in groups], share * len(items) - filled, len(groups) - others
        )
        for index in chosen:
            split_of.update(dict.fromkeys(groups[index], name))
        groups = [group for index, group in enumerate(groups) if index not in chosen]
    return split_of


def _groups(items: Sequence[SplitItem]) -> list[list[str]]:
    """Group samples that are connected by a common clip or body, in order of first appearance."""
    parent: dict[tuple[str, str], tuple[str, str]] = {}

    def root(node: tuple[str, str]) -> tuple[str, str]:
        while parent.setdefault(node, node) != node:
            parent[node] = node = parent[parent[node]]
        return node

    for item in items:
        parent[root(("source", item.source))] = root(("body", item.body))
    groups = defaultdict(list)
    for item in items:
        groups[root(("body", item.body))].append(item.sample)
    return list(groups.values())


def _closest_sum(sizes: Sequence[int], target: float, most: int) -> set[int]:
    """Indices of the sizes whose sum is closest to the target, at least one and at most `most`."""
    if most < 1:
        return set()
    # Reachable sum -> the indices that reach it; stops as soon as the target itself is reached.
    reached: dict[int, tuple[int, ...]] = {0: ()}
    best = round(target)
    for index, size in enumerate(sizes):
        for total, chosen in list(reached.items()):
            if len(chosen) < most and total <= target and total + size not in reached:
                reached[total + size] = (*chosen, index)
        if best > 0 and best in reached:
            break
    closest = min((total for total in reached if total), key=lambda t: (abs(t - target), t))
    return set(reached[closest])
