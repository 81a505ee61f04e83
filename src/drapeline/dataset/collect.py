"""Collect the accepted samples into split folders, with tables of all samples and the card."""

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from drapeline.dataset.card import dataset_card
from drapeline.dataset.record import SAMPLE_MANIFEST, SPLITS, SampleRecord, read_record
from drapeline.dataset.statistics import action_table, garment_table, overview_table
from drapeline.dataset.tables import ACTIONS, GARMENTS_WORN, OVERVIEW, SAMPLES, STATUS
from drapeline.errors import InputError
from drapeline.manifest import FileSum, damages, read_manifest, write_manifest
from drapeline.schema import make_table, write_table
from drapeline.storage import atomic_folder, copy_folder

_LOW_PERCENTILES = ("_p01", "_p01_m", "_p05", "_p05_m")  # the smallest value of these is the worst


def collect_dataset(folders: Iterable[str | Path], output: str | Path) -> list[SampleRecord]:
    """Copy accepted samples to `{output}/{split}/{id}`, write tables and card; all records by id.

    They are copies, not links, so that whatever happens to the published files leaves those alone
    from which they can be made anew. `manifest.tsv` has the sums of all files, those of the samples
    as they were when the samples were written.

    Args:
        folders: one per sample, as written by `write_sample`, including the rejected samples.
        output: folder of the dataset; replaced as a whole.

    Raises:
        InputError: a sample's `meta.json` is unusable, a file of it has another size than when it
            was written, or two samples have the same id.
    """
    records = sorted((read_record(folder) for folder in folders), key=lambda r: r.meta["id"])
    ids = [record.meta["id"] for record in records]
    if len(set(ids)) < len(ids):
        repeated = next(name for name in ids if ids.count(name) > 1)
        raise InputError(f"{output}: sample {repeated} is given twice, expected each id once")
    accepted = [record for record in records if record.accepted]
    statistics = {
        "statistics_overview": (OVERVIEW, overview_table(accepted)),
        "statistics_actions": (ACTIONS, action_table(accepted)),
        "statistics_garments": (GARMENTS_WORN, garment_table(accepted)),
    }
    tables = {
        "status": (STATUS, map(status_row, records)),
        "samples": (SAMPLES, map(sample_row, accepted)),
        **statistics,
    }
    sums = {
        f"{record.meta['split']}/{record.meta['id']}/{file}": wanted
        for record in accepted
        for file, wanted in _checked_manifest(record.folder).items()
    }
    with atomic_folder(output) as scratch:
        for split in SPLITS:
            (scratch / split).mkdir()
        for record in accepted:
            copy_folder(record.folder, scratch / record.meta["split"] / record.meta["id"])
        for name, (schema, rows) in tables.items():
            write_table(scratch / f"{name}.tsv", make_table(schema, rows), schema)
        shown = {name: rows for name, (_, rows) in statistics.items()}
        (scratch / "README.md").write_text(dataset_card(records, shown))
        write_manifest(scratch, known=sums)
    return records


def outcome(records: Sequence[SampleRecord]) -> str:
    """What came of all samples in a sentence: "15 of 16 samples accepted (1 rejected: ...)"."""
    accepted = sum(record.accepted for record in records)
    text = f"{accepted} of {len(records)} samples accepted"
    others = [record.meta for record in records if not record.accepted]
    if not others:
        return text
    if len(others) == 1:
        return f"{text} (1 {others[0]['status']}: {others[0]['reason']})"
    # Measures are counted, not values: each sample has its own.
    reasons = Counter(f"{meta['status']} by {_measure(meta['reason'])}" for meta in others)
    return f"{text} ({', '.join(f'{count} {words}' for words, count in reasons.most_common())})"


def _measure(reason: str) -> str:
    """What the first part of a reason is about: a measure, or the body that overlaps itself."""
    first = reason.split(";")[0]
    return first.split()[0] if ", expected at" in first else first


def accepted_records(dataset: str | Path) -> list[SampleRecord]:
    """Records of the accepted samples of a collected dataset, by id.

    Raises:
        InputError: the folder is no dataset, or a record is unusable.
    """
    dataset = Path(dataset)
    folders = [path for split in SPLITS for path in (dataset / split).glob("*") if path.is_dir()]
    return sorted((read_record(folder) for folder in folders), key=lambda r: r.meta["id"])


def _checked_manifest(folder: Path) -> dict[str, FileSum]:
    for damage in damages(folder, SAMPLE_MANIFEST, sums=False):
        raise damage
    return read_manifest(folder / SAMPLE_MANIFEST)


def status_row(record: SampleRecord) -> dict[str, Any]:
    """Row of `status.tsv`: the outcome of one sample."""
    meta = record.meta
    return {
        "sample": meta["id"],
        "status": meta["status"],
        "reason": "; ".join(filter(None, [meta["reason"], meta["self_collision"]["reason"]])),
        "attempts": len(meta["simulation"].get("attempts", [])),
        "split": meta["split"],
        "sequence": meta["motion"]["sequence"],
        "garments": "+".join(garment["name"] for garment in meta["outfit"]["garments"]),
        "self_collision": meta["self_collision"]["outcome"],
        "thinned": meta["self_collision"]["thinned"],
        "redrawn": meta["self_collision"]["redrawn"],
        "removed_segments": "+".join(meta["self_collision"]["removed_segments"]),
    }


def sample_row(record: SampleRecord) -> dict[str, Any]:
    """Row of `samples.tsv`: one accepted sample."""
    meta = record.meta
    garments = meta["outfit"]["garments"]
    row = {
        "sample": meta["id"],
        "split": meta["split"],
        "gender": meta["body"]["gender"],
        "garments": "+".join(garment["name"] for garment in garments),
        "fabrics": "+".join(garment["fabric"] for garment in garments),
        "action": meta["motion"]["action"],
        "sequence": meta["motion"]["sequence"],
        "subject": meta["motion"]["subject"],
        "source": meta["motion"]["source"],
        "frames": meta["motion"]["frames"],
        "vertices": sum(garment["vertices"] for garment in meta["garments"].values()),
        "floor_penetration_m": meta["motion"]["floor_penetration_m"],
        "contact_sliding_m_s": meta["motion"]["contact_sliding_m_s"],
        "longest_hover_s": meta["motion"]["longest_hover_s"],
        "possible_flight_s": meta["motion"]["possible_flight_s"],
        "body_overlap_share": meta["self_collision"]["overlap_share"],
        "body_overlap_depth_m": meta["self_collision"]["overlap_depth_m"],
        "megabytes": record.cloth3d_bytes / 1e6,
        "megabytes_with_extras": record.total_bytes / 1e6,
    }
    for name, values in meta["health"].items():
        row[f"{name}_mean"] = f"{values['mean']:.6g}"
        worst = "min" if name.endswith(_LOW_PERCENTILES) else "max"
        row[f"{name}_{worst}"] = f"{values[worst]:.6g}"
    return row
