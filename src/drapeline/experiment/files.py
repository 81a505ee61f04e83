"""Where the files of an experiment are, and which samples there will be."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

from drapeline.experiment.checks import require_splits
from drapeline.experiment.groups import PlannedGroup
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import GENDERS
from drapeline.motions.table import MotionEntry
from drapeline.outfits.garment_types import GARMENT_TYPES, GARMENTS, part_of_body

# Only what evaluates reads these splits, nothing that trains.
EVALUATED_SPLITS = ("test",)


@dataclass(frozen=True)
class ExperimentFiles:
    """Files of an experiment by what they hold.

    Patterns have `{group}` and `{shard}`.

    Attributes:
        config: the whole of it, defaults filled in.
        groups: of samples, by name.
        bodies: gender -> file of the body.
        hanging_solver: module of the cloth solver that lets garments hang.
    """

    config: Mapping[str, Any]
    groups: Mapping[str, PlannedGroup]
    bodies: Mapping[str, str]
    hanging_solver: str

    @property
    def hanging(self) -> dict[str, Any]:
        """What a task is told that lets garments hang on people, see `moving_sheets.job_draper`."""
        return {
            "solver": self.hanging_solver,
            "hanging": {
                "edge_length_m": self.config["outfits"]["edge_length_m"],
                "simulation": self.config["simulation"]["settings"],
            },
        }

    @property
    def model_seed(self) -> int:
        """Seed of trainings and evaluations; samples and their clouds have that of the config."""
        chosen = self.config["model_seed"]
        return self.config["seed"] if chosen is None else chosen

    @property
    def results(self) -> str:
        """Folder of all of them."""
        return self.config["results"]

    @property
    def samples(self) -> str:
        """Pattern of folders of CLOTH3D folders, as `samples_of` reads them."""
        return f"{self.results}/samples/{{group}}/{{shard}}"

    @property
    def outfits(self) -> str:
        """Pattern of outfits as they are before they move."""
        return f"{self.results}/outfits/{{group}}/{{shard}}"

    @property
    def moving_bodies(self) -> str:
        """Pattern of bodies in motion."""
        return f"{self.results}/bodies/{{group}}/{{shard}}"

    @property
    def registrations(self) -> str:
        """Pattern of garments registered to the body."""
        return f"{self.results}/registration/{{group}}/{{shard}}"

    @property
    def scans(self) -> str:
        """Pattern of segmented scans of a kind."""
        return f"{self.results}/scans/{{kind}}/{{group}}/{{shard}}.npz"

    def motion(self, clip: MotionEntry) -> str:
        """An imported clip, at the length that it is repeated to."""
        return f"{self.results}/motions/{clip.name}/{clip.loop_frames or 'whole'}.npz"

    @property
    def super_bodies(self) -> dict[str, str]:
        """Gender -> refined body."""
        return {gender: f"{self.results}/super_body/{gender}.npz" for gender in GENDERS}

    @property
    def topology(self) -> str:
        """The two topologies of garments on the refined body."""
        return f"{self.results}/super_body/topology.npz"

    def hierarchy(self, pooling: str) -> str:
        """Mesh hierarchy: "segments" or "uniform"."""
        return f"{self.results}/super_body/hierarchy_{pooling}.npz"

    @property
    def static(self) -> str:
        """Registered garments at rest, of all groups."""
        return f"{self.results}/static"

    def dynamic(self, version: str) -> str:
        """Registered garments in motion, with offsets that are "posed" or "unposed"."""
        return f"{self.results}/dynamic/{version}"

    def learned_by(self, model: str) -> "ExperimentFiles":
        """The same without the groups that a model neither learns from nor is tested on."""
        asked = {name: self.config["groups"][name]["learned_by"] for name in self.groups}
        groups = {
            name: group
            for name, group in self.groups.items()
            if asked[name] is None or model in asked[name]
        }
        return replace(self, groups=groups)

    def metrics(self, table: str) -> str:
        """The table of metrics that evaluations name."""
        return f"{self.results}/{table}.tsv"

    @cached_property
    def moving(self) -> list[PlannedGroup]:
        """Groups of simulated samples."""
        return [group for group in self.groups.values() if not group.at_rest]

    @cached_property
    def resting(self) -> list[PlannedGroup]:
        """Groups of outfits at rest."""
        return [group for group in self.groups.values() if group.at_rest]

    @cached_property
    def published(self) -> list[PlannedGroup]:
        """Groups whose samples are the dataset."""
        return [group for group in self.moving if group.published]

    @cached_property
    def moving_plans(self) -> dict[str, SamplePlan]:
        """Id -> plan of each sample in motion."""
        return {plan.sample: plan for group in self.moving for plan in group.plans}

    @cached_property
    def resting_plans(self) -> dict[str, SamplePlan]:
        """Id -> plan of each outfit at rest."""
        return {plan.sample: plan for group in self.resting for plan in group.plans}

    @cached_property
    def places(self) -> dict[str, dict[str, str]]:
        """Id -> group and shard of each sample in motion."""
        return {
            plan.sample: {"group": group.name, "shard": shard}
            for group in self.moving
            for shard, plans in group.shards.items()
            for plan in plans
        }

    @cached_property
    def scanned(self) -> list[str]:
        """Held-out samples whose scans all models are fitted to.

        A jacket leaves too little to see of what is worn beneath it.
        """

        def is_seen(plan: SamplePlan) -> bool:
            return not any(GARMENT_TYPES[name].outer for name in plan.outfit_type.split("+"))

        count = self.config["scans"]["count"]
        return self.first_of_split(count, EVALUATED_SPLITS[0], is_seen, self.shared)

    def per_shard(self, pattern: str, groups: Iterable[PlannedGroup]) -> list[str]:
        """What a pattern stands for in all shards of groups."""
        return [
            pattern.format(group=group.name, shard=shard)
            for group in groups
            for shard in group.shards
        ]

    def shards_of(self, pattern: str, samples: Iterable[str]) -> list[str]:
        """What a pattern stands for in the shards that have these samples."""
        return list(dict.fromkeys(pattern.format(**self.places[sample]) for sample in samples))

    @cached_property
    def shared(self) -> list[PlannedGroup]:
        """Groups of simulated samples that every model has, about which all are asked."""
        settings = self.config["groups"]
        return [group for group in self.moving if settings[group.name]["learned_by"] is None]

    def first_of_split(
        self,
        count: int,
        split: str,
        wanted: Callable[[SamplePlan], bool] | None = None,
        groups: Sequence[PlannedGroup] | None = None,
    ) -> list[str]:
        """The first samples of a split in each group, in turn over its clips like all of them.

        Args:
            count: of each group, at most.
            split: "train", "val" or "test".
            wanted: whether a plan will do; None takes all.
            groups: of simulated samples; None takes all.
        """
        found = []
        for group in self.moving if groups is None else groups:
            own = filter(wanted, [plan for plan in group.plans if plan.split == split])
            found += [plan.sample for plan in own][:count]
        return found

    @property
    def compared_garments(self) -> list[str]:
        """Garment types that every model learns, on which they are compared."""
        garments, models = self.config["garment4d"]["garments"], self.config["smplicit"]["models"]
        return [name for name in garments if part_of_body(name) in models] or garments

    @property
    def compared(self) -> dict[str, Any]:
        """What comparisons of all models are told."""
        return {
            "garments": self.compared_garments,
            "split": EVALUATED_SPLITS[0],
            "seed": self.model_seed,
        }

    @property
    def outfits_at_rest(self) -> list[str]:
        """All shards of them."""
        return self.per_shard(self.outfits, self.resting)

    @property
    def registered_samples(self) -> dict[str, list[str]]:
        """All simulated samples, and what they are registered as."""
        return {
            "samples": self.per_shard(self.samples, self.moving),
            "registrations": self.per_shard(self.registrations, self.moving),
        }

    def known_scans(self, kind: str) -> dict[str, list[str]]:
        """Scans of one of `dataset.settings.SCAN_KINDS`, and the samples that they are of."""
        scans = self.scans.replace("{kind}", kind)
        return {
            "scans": self.shards_of(scans, self.scanned),
            "samples": self.shards_of(self.samples, self.scanned),
        }

    def types_at_rest(self, *splits: str) -> list[str]:
        """Garment types of outfits at rest of these splits, or all, in the order of `GARMENTS`."""
        plans = [p for p in self.resting_plans.values() if not splits or p.split in splits]
        worn = {name for plan in plans for name in plan.outfit_type.split("+")}
        return [name for name in GARMENTS if name in worn]

    def resting_in(self, *splits: str) -> Callable[[], None]:
        """A check that the plan has outfits at rest in these splits."""
        return self._splits_check(self.resting, splits)

    def moving_in(self, *splits: str) -> Callable[[], None]:
        """A check that the plan has samples in motion in these splits."""
        return self._splits_check(self.moving, splits)

    def _splits_check(
        self, groups: Sequence[PlannedGroup], splits: Sequence[str]
    ) -> Callable[[], None]:
        shares = {group.name: self.config["groups"][group.name] for group in groups}
        planned = [plan.split for group in groups for plan in group.plans]
        return partial(require_splits, planned, splits, groups=shares)

    @cached_property
    def static_size(self) -> float:
        """Outfits at rest, as a multiple of 400, for estimates of time and memory."""
        return len(self.resting_plans) / 400

    @cached_property
    def moving_frames(self) -> int:
        """Simulated frames."""
        return sum(plan.frames for plan in self.moving_plans.values())

    @property
    def moving_size(self) -> float:
        """Simulated frames, as a multiple of 176 samples of two seconds."""
        return self.moving_frames / (176 * 60)

    def gpus(self, model: str) -> int:
        """GPUs that a training of a model asks for: none unless the config insists on them."""
        trainer = self.config[model]["trainer"]
        if trainer["accelerator"] != "gpu":
            return 0
        return trainer["devices"] if trainer["devices"] not in ("auto", -1) else 1
