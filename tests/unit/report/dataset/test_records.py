"""Records of the samples of a dataset."""

from drapeline.report.dataset.records import accepted_records


def test_accepted_samples_of_all_splits_come_by_id(dataset):
    records = accepted_records(dataset.path)
    assert [record.meta["id"] for record in records] == ["00001", "00002", "00004"]
    assert all(record.accepted for record in records)


def test_a_dataset_without_accepted_samples_has_no_records(rejected):
    assert accepted_records(rejected.path) == []
