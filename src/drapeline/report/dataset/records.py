"""Records of the samples that a collected dataset holds."""

from pathlib import Path

from drapeline.dataset.record import SampleRecord, read_record
from drapeline.dataset.splits import SPLITS


def accepted_records(dataset: str | Path) -> list[SampleRecord]:
    """Records of the accepted samples of a collected dataset, by id.

    Raises:
        InputError: the folder is no dataset, or a record is unusable.
    """
    dataset = Path(dataset)
    folders = [path for split in SPLITS for path in (dataset / split).glob("*") if path.is_dir()]
    return sorted((read_record(folder) for folder in folders), key=lambda r: r.meta["id"])
