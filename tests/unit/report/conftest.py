from types import SimpleNamespace

import pytest

from drapeline.dataset.collect import accepted_records, collect_dataset
from toys.tiny_sample import write_tiny_sample


def made(stages, body, *plan):
    """A collected dataset of (id, split, status, gender) with its accepted records."""
    folders = [
        write_tiny_sample(
            stages, body, name, split, status=status, gender=gender, source=f"clip{name}.bvh"
        ).folder
        for name, split, status, gender in plan
    ]
    collect_dataset(folders, stages / "dataset")
    return SimpleNamespace(
        path=stages / "dataset",
        records=accepted_records(stages / "dataset"),
        samples=stages / "samples",
    )


@pytest.fixture(scope="session")
def dataset(tmp_path_factory, toy_body):
    """Three accepted samples and a rejected one; not to be changed."""
    return made(
        tmp_path_factory.mktemp("report"),
        toy_body,
        ("00001", "train", "accepted", "female"),
        ("00002", "train", "accepted", "male"),
        ("00003", "val", "rejected", "female"),
        ("00004", "test", "accepted", "female"),
    )


@pytest.fixture(scope="session")
def rejected(tmp_path_factory, toy_body):
    """A dataset without any accepted sample."""
    return made(
        tmp_path_factory.mktemp("report"), toy_body, ("00001", "train", "rejected", "female")
    )
