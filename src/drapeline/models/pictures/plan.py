"""Which held-out samples pictures are taken of; for planning, so it imports little."""

from collections.abc import Callable
from typing import Any

from drapeline.experiment.files import EVALUATED_SPLITS, ExperimentFiles
from drapeline.experiment.sample_plan import SamplePlan


def pictured_samples(files: ExperimentFiles, knows: Callable[[SamplePlan], bool]) -> dict[str, Any]:
    """What `known.pictures_of_job` is told: of which samples pictures are taken, and how many.

    Of those that are published any will do; of each other group some are taken. Models that know
    all garments thus have the same pictures.

    Args:
        knows: whether a planned sample wears something that the model has learned.
    """
    asked, split = files.config["smplicit"]["evaluate_images"], EVALUATED_SPLITS[0]
    published = {group.name for group in files.published}
    some = files.first_of_split(asked["others"], split, knows)
    return {
        "split": split,
        "samples": [
            plan.sample
            for group in files.published
            for plan in group.plans
            if plan.split == split and knows(plan)
        ],
        "pictures": asked["count"],
        "others": [one for one in some if files.places[one]["group"] not in published],
        "size_px": asked["size_px"],
    }
