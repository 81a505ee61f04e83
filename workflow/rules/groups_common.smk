# The groups of samples, and what all rules ask of them.
import re
from dataclasses import asdict

from drapeline.dataset.record import SPLITS, outfit_text, read_meta
from drapeline.dataset.settings import CLEAN, NOISY, SCAN_KINDS, WORSE
from drapeline.experiment.cloth_solvers import CLOTH_SOLVERS, QUICK_SOLVER
from drapeline.experiment.files import ExperimentFiles
from drapeline.outfits.settings import own_garments

FILES = ExperimentFiles(config, GROUPS, WHOLE_BODIES, QUICK_SOLVER.code)
MOVING, RESTING, PUBLISHED = FILES.moving, FILES.resting, FILES.published
SAMPLE, OUTFITS, REGISTRATION = FILES.samples, FILES.outfits, FILES.registrations
per_shard, shards_of = FILES.per_shard, FILES.shards_of
# Every clip, at the length that cyclic ones are repeated to: a group may want another.
MOTIONS = {
    (name, str(clip.loop_frames or "whole")): clip
    for group in MOVING
    for name, clip in group.clips.items()
}


def one_of(names, pattern):
    """Constraint of a wildcard; a long alternation would make the matching of n jobs quadratic."""
    return "|".join(map(re.escape, names)) if len(names) <= 500 else pattern


wildcard_constraints:
    group="|".join(GROUPS),
    shard=one_of(
        [shard for group in GROUPS.values() for shard in group.shards], r"\w*\d"
    ),
    sample=one_of(FILES.moving_plans, r"\w*\d"),
    sequence=one_of(dict.fromkeys(name for name, _ in MOTIONS), r"[^/]+"),
    length=r"whole|\d+",


def group_names(groups):
    """Constraint of the wildcard `group`: one of some, of which there may be none."""
    return "|".join(group.name for group in groups) or "(?!)"


def sample_shard(wildcards):
    """Input function: the shard with a sample."""
    return SAMPLE.format(**FILES.places[wildcards.sample])


def plans_of(wildcards):
    """Plans of a shard."""
    return GROUPS[wildcards.group].shards[wildcards.shard]


def sample_priority(wildcards):
    """Priority function: of jobs for a shard; of published ones, those of a quick solver come first."""
    if not GROUPS[wildcards.group].published:
        return SAMPLES_FIRST
    return PUBLISHED_FIRST + 1 / solver_of(wildcards).sample_s


def clip_priority(wildcards):
    """Priority function: of jobs for a clip."""
    clip = clip_entry(wildcards)
    published = any(clip in group.clips.values() for group in PUBLISHED)
    return PUBLISHED_FIRST if published else SAMPLES_FIRST


def shard_ids(wildcards):
    """Params function: ids of a shard's samples."""
    return [plan.sample for plan in plans_of(wildcards)]


def shard_splits(wildcards):
    """Params function: the splits of a shard's samples, by their ids."""
    return {plan.sample: plan.split for plan in plans_of(wildcards)}


def shard_plans(wildcards):
    """Params function: what the samples of a shard are made from.

    Splits count only of those at rest; of the others, they are known when samples are written.
    """
    plans = [asdict(plan) for plan in plans_of(wildcards)]
    if not GROUPS[wildcards.group].at_rest:
        plans = [{**plan, "split": ""} for plan in plans]
    return plans


def solver_of(wildcards):
    """The cloth solver of a group."""
    return CLOTH_SOLVERS[GROUPS[wildcards.group].solver]


def solver_module(wildcards):
    """Params function: the module of a group's solver."""
    return solver_of(wildcards).code


def solver_environment(wildcards):
    """The environment of a group's solver."""
    return f"../../envs/{solver_of(wildcards).environment}.yaml"


def solver_hash(script):
    """Params function: `source_hash` of a script that a group's solver is part of."""

    def digest(wildcards):
        return source_hash(script, solver_module(wildcards))

    return digest


def group_settings(part, *keys):
    """Params function: settings of a part of the config, as they hold for a group."""

    def chosen(wildcards):
        settings = getattr(GROUPS[wildcards.group], part)
        return {key: settings[key] for key in keys or settings}

    return chosen


# What lets outfits hang.
HANGING_MODULES = ["drapeline.generation.hung_outfits", QUICK_SOLVER.code]


def clip_entry(wildcards):
    """A clip at one length."""
    return MOTIONS[wildcards.sequence, wildcards.length]


def motion_files(wildcards):
    """Input function: the clip, and the joint map and skeleton it may need."""
    return clip_entry(wildcards).files


def skeleton_files(wildcards):
    """Input function: the same of a clip at any length."""
    return next(
        clip.files for (name, _), clip in MOTIONS.items() if name == wildcards.sequence
    )


def motion_parameters(wildcards):
    """Params function: what else the importer is told: loop, feet, labels."""
    lock_feet = config["motions"]["lock_feet"]
    return {**clip_entry(wildcards).parameters(), "lock_feet": lock_feet}


def motion_sums(wildcards):
    """Params function: SHA-256 sums that files must have, where the table has some."""
    return clip_entry(wildcards).sums


def shard_motions(wildcards):
    """Input function: the clips that the samples of a shard are pieces of."""
    return list(map(FILES.motion, GROUPS[wildcards.group].clips_of(wildcards.shard)))


def shard_bodies(wildcards):
    """Input function: bodies in motion; at rest, outfits have none but their own."""
    group = GROUPS[wildcards.group]
    folder = f"{RESULTS}/bodies/{wildcards.group}/{wildcards.shard}"
    return [] if group.at_rest else folder


def group_own_garments(wildcards):
    """Params function: the user's own garments, by gender and type."""
    return own_garments(GROUPS[wildcards.group].outfits["own_garments"])


def own_garment_files(wildcards):
    """Input function: the OBJ files of these."""
    own = group_own_garments(wildcards)
    return sorted({one["path"] for worn in own.values() for one in worn.values()})


def hangs(wildcards):
    """Whether outfits of a group hang on their bodies before they are used."""
    group = GROUPS[wildcards.group]
    return group.at_rest and group.outfits["hang_frames"] > 0


def hanging(wildcards):
    """Params function: what lets outfits hang; nothing of it counts where they do not."""
    if not hangs(wildcards):
        return {}
    group = GROUPS[wildcards.group]
    return {
        "modules": HANGING_MODULES,
        "accelerator": config["simulation"]["accelerator"],
        "how": {
            "frames": group.outfits["hang_frames"],
            "settings": group.simulation,
            "bounds": config["simulation"]["bounds"],
        },
    }


def outfits_hash(wildcards):
    """Params function: digest of what makes a group's outfits."""
    return source_hash("make_outfits", *(HANGING_MODULES if hangs(wildcards) else []))


def attempt_settings(wildcards):
    """Params function: settings of one attempt, of which the number of attempts is no part."""
    settings = GROUPS[wildcards.group].simulation
    return {key: value for key, value in settings.items() if key != "attempts"}


def gallery_labels(wildcards, input):
    """Labels function: what a sample shows, which its own record knows once it is made."""
    meta = read_meta(Path(input[0]) / wildcards.sample)
    return {
        "sample": wildcards.sample,
        "motion": meta["motion"]["sequence"],
        "wears": outfit_text(meta),
    }


def samples_side_by_side(wildcards):
    """Input function: the shards with the samples whose ids, joined by hyphens, name the picture."""
    return shards_of(SAMPLE, wildcards.samples.split("-"))


def ids_side_by_side(wildcards):
    """Params function: these samples."""
    return wildcards.samples.split("-")


def group_samples(wildcards):
    """Input function: all samples of a group."""
    return per_shard(SAMPLE, [GROUPS[wildcards.group]])


def scanned_of_shard(wildcards):
    """Params function: the samples of a shard that are scanned."""
    return [sample for sample in shard_ids(wildcards) if sample in FILES.scanned]
