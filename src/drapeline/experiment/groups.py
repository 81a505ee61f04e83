"""Groups of samples: each with a solver and settings of its own, made in shards."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from drapeline.dataset.record import SPLITS
from drapeline.errors import InputError
from drapeline.experiment.plan import Wardrobe, cut_pieces, plan_at_rest, plan_moving, split_clips
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.motions.table import FrameCounts, MotionEntry, MotionTable

# In place of a solver's name: garments at rest on bodies at rest, which nothing moves.
AT_REST = "none"


@dataclass(frozen=True)
class PlannedGroup:
    """Samples of one kind."""

    name: str  # key of `groups` in the settings
    solver: str  # cloth solver that moves the garments; `AT_REST` for garments that do not move
    published: bool  # whether its samples are part of the dataset
    outfits: Mapping[str, Any]  # the settings `outfits` as they hold here
    simulation: Mapping[str, Any]  # the settings `simulation.settings` as they hold here
    clips: Mapping[str, MotionEntry]  # clip -> what its pieces are cut from; empty at rest
    # Shard -> plans of the samples that one job makes. A shard is called like its first sample, so
    # that its name does not depend on how many there are.
    shards: Mapping[str, Sequence[SamplePlan]]

    @property
    def at_rest(self) -> bool:
        """Whether garments and bodies do not move."""
        return self.solver == AT_REST

    @cached_property
    def plans(self) -> list[SamplePlan]:
        """Of all samples, in order."""
        return [plan for plans in self.shards.values() for plan in plans]

    def clips_of(self, shard: str) -> list[MotionEntry]:
        """The clips that the samples of a shard move through, each once."""
        return [self.clips[name] for name in dict.fromkeys(p.sequence for p in self.shards[shard])]


def make_shards(plans: Sequence[SamplePlan], size: int) -> dict[str, list[SamplePlan]]:
    """Shard -> plans of `size` samples, the last of fewer; it is called like its first sample."""
    return {
        plans[start].sample: list(plans[start : start + size])
        for start in range(0, len(plans), size)
    }


def plan_groups(
    settings: Mapping[str, Any], table: MotionTable, counts: FrameCounts | None = None
) -> dict[str, PlannedGroup]:
    """Plan every group of an experiment that has samples.

    A clip has one split in all groups: that of the table, or else what the first group that uses
    it decides.

    Args:
        settings: the whole experiment, defaults filled in.

    Raises:
        InputError: a setting of a group contradicts another one, or its clips.
    """
    groups: dict[str, PlannedGroup] = {}
    splits = dict(table.splits)
    for clip, split in splits.items():
        if split not in SPLITS:
            raise InputError(
                f"{table.path}: '{clip}' has split '{split:.100}', expected one of"
                f" {', '.join(SPLITS)}"
            )
    for name, own in settings["groups"].items():
        if own["count"] != 0:
            groups[name], own_splits = _plan(name, settings, splits, table, counts)
            splits |= own_splits
    _refuse_shared_ids(groups)
    return groups


def _plan(
    name: str,
    settings: Mapping[str, Any],
    known: Mapping[str, str],
    table: MotionTable,
    counts: FrameCounts | None,
) -> tuple[PlannedGroup, dict[str, str]]:
    """A group, and the splits of its clips."""
    own = settings["groups"][name]
    solver = own["solver"] or settings["simulation"]["solver"]
    motions, outfits, simulation = (
        own_settings(common, own[part])
        for part, common in (
            ("motions", settings["motions"]),
            ("outfits", settings["outfits"]),
            ("simulation", settings["simulation"]["settings"]),
        )
    )
    prefix = default_prefix(name) if own["prefix"] is None else own["prefix"]
    shares = {"val": own["val_share"], "test": own["test_share"]}
    wardrobe = Wardrobe(settings["body"]["female_share"], outfits["types"], outfits["male_skirts"])
    clips, splits = {}, {}
    if solver == AT_REST:
        plans = plan_at_rest(own["count"], prefix, shares, wardrobe)
    else:
        clips = table.entries(
            motions["sequences"], loop_frames=motions["loop_frames"], counts=counts
        )
        frames_of = {clip: entry.frames for clip, entry in clips.items()}
        pieces = cut_pieces(settings["seed"], frames_of, motions)
        splits = split_clips(settings["seed"], name, pieces.sizes, shares, known)
        count = pieces.count if own["count"] is None else own["count"]
        plans = plan_moving(count, prefix, pieces.of_sample, splits, wardrobe)
    shards = make_shards(plans, own["shard_size"])
    return PlannedGroup(name, solver, own["published"], outfits, simulation, clips, shards), splits


def own_settings(common: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as they hold for a group: its own, but where they are None those of all."""
    return {**common, **{key: value for key, value in own.items() if value is not None}}


def default_prefix(name: str) -> str:
    """Beginning of the ids of a group's samples, before their number."""
    return f"{name}_" if name[-1].isdigit() else name


def _refuse_shared_ids(groups: Mapping[str, PlannedGroup]) -> None:
    owner: dict[str, str] = {}
    for group in groups.values():
        for plan in group.plans:
            other = owner.setdefault(plan.sample, group.name)
            if other != group.name:
                raise InputError(
                    f"groups.{group.name}.prefix gives a sample the id {plan.sample}, which one of"
                    f" groups.{other} has, expected another prefix"
                )
