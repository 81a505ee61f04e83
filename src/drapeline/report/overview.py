"""The front page of the report: pictures of the samples, and the numbers that matter."""

import base64
import io
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageSequence

from drapeline.dataset.collect import accepted_records
from drapeline.dataset.record import SampleRecord, outfit_text
from drapeline.dataset.tables import OVERVIEW, STATUS
from drapeline.metrics import smplicit
from drapeline.metrics.registry import variant
from drapeline.metrics.table import ALL
from drapeline.report.dataset.health import MEASURES
from drapeline.report.html import write_page
from drapeline.report.registration_table import SUMMARY
from drapeline.report.tables import read_test_metrics
from drapeline.schema import Table, read_table

# The page must stay below what browsers open in a frame, together with its pictures' base64.
_SHEET_BYTES = 700_000
_SHEET_MAX = 400
_SHEET_FORMS = ((180, True), (180, False), (120, False), (80, False))  # width, and whether moving
_SHOWN = 8
_SHOWN_WIDTH = 300
_SHOWN_FRAMES = 45  # 3 s of the gallery's moving pictures
_STYLE = """<style>
.overview .shown { display: grid; gap: 4px;
  grid-template-columns: repeat(auto-fit, minmax(min(46%, 15rem), 1fr)); }
.overview .shown img { width: 100%; max-height: 25rem; object-fit: contain; margin: 0; }
.overview .numbers { display: grid; grid-template-columns: repeat(auto-fill, minmax(11.5rem, 1fr));
  gap: .6rem; margin: 1rem 0; padding: 0; }
.overview .numbers div { border: 1px solid #e3e5e8; border-radius: .4rem; padding: .5rem .7rem; }
.overview dt { font-size: .82rem; font-weight: 400; color: #6b6f76; margin: 0; }
.overview dd { margin: 0; padding: 0; font-size: .82rem; line-height: 1.35; color: #444; }
.overview dd strong { display: block; font-size: 1.35rem; color: #222; }
.overview .sheet { display: grid; grid-template-columns: repeat(auto-fill, minmax(8.6rem, 1fr));
  gap: .7rem; }
.overview figure { margin: 0; font-size: .78rem; line-height: 1.35; color: #444; }
.overview figure img { width: 100%; margin: 0; display: block; }
.overview figure strong { color: #222; }
</style>"""


class KeyNumber(NamedTuple):
    """A number that matters."""

    title: str
    value: str  # with its unit
    note: str  # what to hold it against


class _Comparison(NamedTuple):
    """An error of a model beside those of other models and of the best baseline.

    Where models are trained apart, their variants stand in one text, with spaces between them; the
    error is their mean.
    """

    title: str
    metric: str  # in millimetres
    models: Sequence[str]  # variants; the first that was evaluated is shown
    networks: Sequence[str]  # variants, of the papers; they stand beside it
    baselines: Sequence[str]  # variants; the best stands beside it


def _of_parts(name: str) -> str:
    """A variant of each of SMPLicit's models."""
    return " ".join(f"{smplicit.MODEL}_{part}_{name}" for part in smplicit.PARTS)


_COMPARISONS = (
    _Comparison(
        "Garments at rest, rebuilt from codes",
        "surface_error_mm",
        ["static_ppca", "svae"],
        ["svae"],
        ["pca", "mean_garment", "nearest_cvar"],
    ),
    _Comparison(
        "Garments in motion, rebuilt from codes",
        "surface_error_mm",
        ["dynamic_ppca_settled", "dynamic_ppca", "dvae_unposed_4"],
        ["dvae_unposed_4"],
        ["wrinkle_pca"],
    ),
    _Comparison(
        "Garments in motion, predicted from poses",
        "surface_error_mm",
        ["wrinkle_mlp", "dynamic_ppca_prior", "dvae_unposed_4_prior"],
        ["dvae_unposed_4_prior"],
        ["wrinkle_ridge", "skinned_mean", "skinned_static"],
    ),
    _Comparison(
        "Garments in motion, from point clouds",
        "vertex_error_mm",
        ["ours", "posed"],
        ["posed"],
        ["lbs", "untrained"],
    ),
    _Comparison(
        "Garments at rest, from distance fields",
        "surface_to_true_mm",
        [_of_parts("fitted")],
        [],
        [_of_parts("nearest_cut"), _of_parts("mean_code")],
    ),
)


def write_overview(
    path: str | Path,
    dataset: str | Path,
    pictures: Mapping[str, str | Path],
) -> None:
    """Write the page of the samples: some in motion, the numbers of the dataset, and all in small.

    Args:
        path: the HTML page; the report's front page, `workflow.rst`, shows what it holds.
        dataset: folder of the collected dataset.
        pictures: sample -> its still; `{sample}_moving.png` beside it is in motion.

    Raises:
        InputError: a table is missing or unusable.
    """
    dataset = Path(dataset)
    status = read_table(dataset / "status.tsv", STATUS)
    records = accepted_records(dataset)
    worn = {record.meta["id"]: outfit_text(record.meta) for record in records}
    write_page(
        path,
        "Overview",
        f'<div class="overview">{_STYLE}',
        _wall([pictures[sample] for sample in _evenly([*worn], _SHOWN)]),
        _numbers(_dataset_figures(dataset, status, records)),
        "<!-- samples --><h2>All samples</h2>",
        _sheet(status, worn, pictures),
        "</div><!-- overview -->",
    )


def write_errors(path: str | Path, registration: str | Path, metrics: str | Path) -> None:
    """Write the page of what models get wrong, which the report's front page shows as well.

    Args:
        path: the HTML page.
        registration: table of the errors of the round trip.
        metrics: table of all metrics; models that it does not hold have no number.

    Raises:
        InputError: a table is missing or unusable.
    """
    write_page(
        path,
        "Errors of the models",
        f'<div class="overview">{_STYLE}',
        _numbers([*_registration_figures(registration), *_model_figures(metrics)]),
        "</div><!-- overview -->",
    )


def _dataset_figures(
    dataset: Path, status: Table, records: Sequence[SampleRecord]
) -> list[KeyNumber]:
    overview = read_table(dataset / "statistics_overview.tsv", OVERVIEW).set_index("measure")["all"]
    at_once = ((status["status"] == "accepted") & (status["attempts"] == 1)).sum()
    figures = [
        KeyNumber("Samples", f"{len(records)} of {len(status)}", "accepted"),
        KeyNumber(
            "Accepted at the first attempt",
            f"{100 * at_once / max(len(status), 1):.0f} %",
            "of all samples",
        ),
    ]
    if not records:
        return figures
    inside = MEASURES["penetration"]
    share = np.mean([inside.values(record)[1] for record in records])
    return [
        *figures,
        KeyNumber(
            "Frames",
            f"{int(overview['frames']):,}",
            f"{overview['actions']} actions from {overview['motion clips']} motion clips",
        ),
        KeyNumber(
            "Garments",
            overview["garments"],
            f"of {overview['garment types']} types and {overview['fabrics']} fabrics",
        ),
        KeyNumber(
            "Bodies",
            overview["subjects (bodies)"],
            f"{overview['female']} female, {overview['male']} male",
        ),
        KeyNumber(
            "Garment vertices inside the body",
            f"{share:.{inside.digits}f} {inside.unit}",
            f"mean over frames; the goal is at most {inside.bounds[1]:g} {inside.unit}",
        ),
    ]


def _registration_figures(table: str | Path) -> list[KeyNumber]:
    errors = read_table(table, SUMMARY)
    errors = errors[errors["metric"] == "garment_to_rebuilt_mean_mm"]
    garments = int(errors["garments"].sum())
    if not garments:
        return []
    mean = errors["total"].sum() / garments
    return [KeyNumber("Registration error", f"{mean:.2f} mm", f"mean of {garments} garments")]


def _model_figures(metrics: str | Path) -> list[KeyNumber]:
    measured = read_test_metrics(metrics)
    measured = measured[measured["source"] == ""]
    figures = []
    for comparison in _COMPARISONS:
        errors = {
            name: error
            for name in {*comparison.models, *comparison.networks, *comparison.baselines}
            if (error := _mean_error(measured, name, comparison.metric))
        }
        models = [name for name in comparison.models if name in errors]
        if not models:
            continue
        beside = [name for name in comparison.networks if name in errors and name != models[0]]
        baselines = [name for name in comparison.baselines if name in errors]
        if baselines:
            beside.append(min(baselines, key=lambda name: errors[name].value))
        notes = [errors[models[0]].title]
        notes += [f"{errors[name].title}: {errors[name].value:.1f} mm" for name in beside]
        value = f"{errors[models[0]].value:.1f} mm"
        figures.append(KeyNumber(comparison.title, value, "; ".join(notes)))
    return figures


class _Error(NamedTuple):
    """Mean error of a variant, or of several that are trained apart, with their title."""

    title: str
    value: float


def _mean_error(measured: Table, variants: str, metric: str) -> _Error | None:
    """Over all test garments or, where models are trained apart, the mean of theirs."""
    named = measured["variant"].isin(variants.split())
    found = measured[named & (measured["metric"] == metric)]
    if not len(found):
        return None
    whole = found[found["garment"] == ALL]
    first = found.iloc[0]
    values = whole["value"] if len(whole) else found["value"]
    return _Error(variant(first["model"], first["variant"]).title, float(np.mean(values)))


def _numbers(figures: Iterable[KeyNumber]) -> str:
    cells = "\n".join(
        f"<div><dt>{escape(title)}</dt><dd><strong>{escape(value)}</strong>{escape(note)}</dd></div>"
        for title, value, note in figures
    )
    return f'<dl class="numbers">\n{cells}\n</dl>'


def _wall(pictures: Sequence[str | Path]) -> str:
    """Some samples in motion."""
    uris = {Path(picture).stem: _small(picture, _SHOWN_WIDTH, moving=True) for picture in pictures}
    images = "".join(
        f'<img src="{uri}" alt="Sample {escape(sample)}">' for sample, uri in uris.items()
    )
    return f'<div class="shown">{images}</div>' if images else ""


def _sheet(status: Table, worn: Mapping[str, str], pictures: Mapping[str, str | Path]) -> str:
    """All samples in small or, of very many, as many as the page has room for."""
    shown = status[status["sample"].isin([*pictures])]
    rows = _evenly(list(shown.itertuples()), _SHEET_MAX)
    for width, moving in _SHEET_FORMS:
        small = [_small(pictures[row.sample], width, moving=moving) for row in rows]
        size = sum(map(len, small))
        if size <= _SHEET_BYTES:
            break
    room = len(rows) if size <= _SHEET_BYTES else int(len(rows) * _SHEET_BYTES / size)
    cells = "\n".join(
        f'<figure><img src="{uri}" alt=""><figcaption>{_caption(row, worn)}</figcaption></figure>'
        for row, uri in _evenly(list(zip(rows, small, strict=True)), room)
    )
    note = f"<p>{room} of {len(status)}.</p>" if room < len(status) else ""
    return f'{note}<div class="sheet">\n{cells}\n</div>'


def _caption(row: Any, worn: Mapping[str, str]) -> str:
    name = f"<strong>{escape(row.sample)}</strong> {escape(row.sequence)}"
    return f"{name}<br>{escape(worn.get(row.sample, row.status))}"


def _evenly(items: Sequence, count: int) -> list:
    """At most so many of the items, spread evenly."""
    chosen = np.unique(np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int))
    return [items[k] for k in chosen]


def _small(picture: str | Path, width: int, *, moving: bool) -> str:
    """A picture this wide as a URI; in motion, if that is wanted and lies beside it."""
    beside = Path(picture).with_name(f"{Path(picture).stem}_moving{Path(picture).suffix}")
    if moving and beside.is_file():
        return _uri(_webp(beside, width), "webp")
    return _uri(_jpeg(picture, width), "jpeg")


def _jpeg(path: str | Path, width: int) -> bytes:
    stream = io.BytesIO()
    with Image.open(path) as picture:
        small = picture.convert("RGB")
        small.thumbnail((width, picture.height))
        small.save(stream, format="JPEG", quality=82, optimize=True)
    return stream.getvalue()


def _webp(path: Path, width: int) -> bytes:
    """A moving picture again, smaller and shorter, that begins anew when it has ended."""
    stream = io.BytesIO()
    with Image.open(path) as picture:
        pause_ms = picture.info.get("duration", 66)
        frames = []
        for shown in islice(ImageSequence.Iterator(picture), _SHOWN_FRAMES):
            frame = shown.convert("RGB")
            frame.thumbnail((width, frame.height))
            frames.append(frame)
    first, *others = frames
    first.save(
        stream,
        format="WEBP",
        save_all=True,
        append_images=others,
        duration=round(pause_ms),
        loop=0,
        quality=60,
        method=4,
    )
    return stream.getvalue()


def _uri(data: bytes, kind: str) -> str:
    # In lines, for reStructuredText, which the front page passes through, refuses long ones.
    return f"data:image/{kind};base64,{base64.encodebytes(data).decode()}"
