"""Which held-out samples pictures are taken of; for planning, so it imports little."""

from typing import Any

from drapeline.experiment.files import EVALUATED_SPLITS, ExperimentFiles
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.outfits.garment_types import part_of_body


def pictured_samples(files: ExperimentFiles) -> dict[str, Any]:
    """What `known.pictures_of_job` is told: of which samples pictures are taken, and how many.

    They wear something that SMPLicit has a model of, which were the first to be evaluated in
    pictures. Of those that are published any will do; of each other group some are taken.
    """
    config, split = files.config["smplicit"], EVALUATED_SPLITS[0]
    asked, models = config["evaluate_images"], config["models"]

    def is_wanted(plan: SamplePlan) -> bool:
        return any(part_of_body(garment) in models for garment in plan.outfit_type.split("+"))

    published = {group.name for group in files.published}
    some = files.first_of_split(asked["others"], split, is_wanted, files.shared)
    return {
        "split": split,
        "samples": [
            plan.sample
            for group in files.shared
            if group.published
            for plan in group.plans
            if plan.split == split and is_wanted(plan)
        ],
        "pictures": asked["count"],
        "others": [one for one in some if files.places[one]["group"] not in published],
        "size_px": asked["size_px"],
        "picture_seed": files.config["seed"],
    }
