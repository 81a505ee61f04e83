import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

from drapeline.errors import InputError
from drapeline.metrics.table import write_metrics
from drapeline.report.overview import write_errors, write_overview
from drapeline.report.registration_table import SUMMARY
from drapeline.schema import make_table, write_table
from toys.metric_rows import metric_row, metric_table

REGISTRATION = make_table(
    SUMMARY,
    [
        {"source": "static", "garment": garment, "metric": metric, "garments": count}
        | {"mean": 1.0, "median": 1.0, "max": 1.0, "total": total, "unit": "mm"}
        for garment, metric, count, total in (
            ("Skirt", "garment_to_rebuilt_mean_mm", 3, 0.9),
            ("Skirt", "garment_to_rebuilt_max_mm", 3, 60.0),
            ("Top", "garment_to_rebuilt_mean_mm", 1, 0.7),
        )
    ],
)


METRICS = [
    metric_row("static_ppca", "all", "surface_error_mm", 1.0, model="ppca", split="val"),
    metric_row("static_ppca", "all", "surface_error_mm", 3.26, model="ppca"),
    metric_row("svae", "all", "surface_error_mm", 12.0, model="svae"),
    metric_row("mean_garment", "all", "surface_error_mm", 15.4, model="baseline"),
    metric_row("pca", "all", "surface_error_mm", 5.3, model="baseline"),
    metric_row("posed", "Skirt", "vertex_error_mm", 40.0),
    metric_row("posed", "Tshirt", "vertex_error_mm", 50.0),
    metric_row("posed", "Tshirt", "vertex_error_mm", 90.0, source="xpbd"),
    *(
        metric_row(
            f"smplicit_{model}_{variant}", "all", "surface_to_true_mm", value, model="smplicit"
        )
        for model, variant, value in (
            *[("upper", "fitted", 3.0), ("skirt", "fitted", 5.0)],
            *[("upper", "mean_code", 20.0), ("upper", "nearest_cut", 30.0)],
        )
    ),
    metric_row("smplicit_images_fitted", "all", "surface_to_true_mm", 500.0),
    metric_row("smplicit_skirt_fitted", "Skirt", "surface_to_true_mm", 500.0),
]


@pytest.fixture
def overview(tmp_path):
    """overview(dataset) -> the page's text"""

    def write(dataset, size=(48, 64)):
        rng = np.random.default_rng(0)
        pictures = {}
        for name in ("00001", "00002", "00003", "00004"):
            pictures[name] = tmp_path / f"{name}.png"
            pixels = rng.integers(256, size=(size[1], size[0], 3), dtype=np.uint8)
            Image.fromarray(pixels).save(pictures[name])
        page = tmp_path / "overview.html"
        write_overview(page, dataset.path, pictures)
        return page.read_text()

    return write


@pytest.fixture
def errors(tmp_path):
    """errors(metrics) -> the page's text"""

    def write(metrics=METRICS):
        registration, table = tmp_path / "registration.tsv", tmp_path / "metrics.tsv"
        write_table(registration, REGISTRATION, SUMMARY)
        write_metrics(table, metric_table(metrics))
        page = tmp_path / "errors.html"
        write_errors(page, registration, table)
        return page.read_text()

    return write


def numbers(text):
    found = re.findall(r"<dt>(.*?)</dt><dd><strong>(.*?)</strong>(.*?)</dd>", text)
    return {title: (value, note) for title, value, note in found}


def test_numbers_are_those_of_the_tables(overview, dataset):
    shown = numbers(overview(dataset))
    assert shown["Samples"] == ("3 of 4", "accepted")
    assert shown["Accepted at the first attempt"][0] == "75 %"
    assert shown["Frames"][0] == "18"
    assert shown["Bodies"][1] == "2 female, 1 male"


def test_errors_stand_beside_the_best_baseline_and_only_for_models_that_there_are(errors):
    shown = numbers(errors())
    assert shown["Registration error"] == ("0.40 mm", "mean of 4 garments")
    at_rest = shown["Garments at rest, rebuilt from codes"]
    assert at_rest == ("3.3 mm", "Masked PPCA (ours); Garment VAE: 12.0 mm; PCA of offsets: 5.3 mm")
    assert "Garments in motion, rebuilt from codes" not in shown
    # The mean of the types, and a baseline that was not evaluated.
    assert shown["Garments in motion, from point clouds"] == ("45.0 mm", "Garment4D, posed stage")
    fields = shown["Garments at rest, from distance fields"]
    assert fields == ("4.0 mm", "SMPLicit, fitted code; SMPLicit, mean code: 20.0 mm")
    assert not any(title.startswith("Garments ") for title in numbers(errors([])))


def test_every_sample_is_in_the_sheet_with_motion_garments_and_fabrics(overview, dataset):
    text = overview(dataset)
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", text)
    assert len(captions) == 4
    meta = dataset.records[0].meta
    worn = meta["outfit"]["garments"][0]
    assert meta["motion"]["sequence"] in captions[0]
    assert f"{worn['name']} ({worn['fabric']})" in captions[0]
    assert captions[2].endswith("rejected")


def test_pictures_are_small_whole_and_in_short_lines(overview, dataset):
    text = overview(dataset, size=(480, 640))
    assert len(text) < 1_500_000
    assert max(map(len, text.splitlines())) < 10_000  # docutils' limit
    uris = re.findall(r'src="data:image/jpeg;base64,(.*?)"', text, re.DOTALL)
    assert len(uris) == 3 + 4
    for uri in uris:
        with Image.open(io.BytesIO(base64.b64decode(uri))) as picture:
            assert picture.width * 4 == picture.height * 3


def test_samples_move_where_there_are_moving_pictures_of_them(overview, dataset, tmp_path):
    still = Image.new("RGB", (48, 64), "red")
    frames = [Image.new("RGB", (48, 64), ("blue", "white")[k % 2]) for k in range(60)]
    path = tmp_path / "00001_moving.png"
    still.save(path, save_all=True, append_images=frames, duration=67, loop=0)
    text = overview(dataset)
    uri, small = re.findall(r'src="data:image/webp;base64,(.*?)"', text, re.DOTALL)
    assert len(small) <= len(uri)
    with Image.open(io.BytesIO(base64.b64decode(uri))) as picture:
        assert picture.n_frames == 45
        assert picture.info["loop"] == 0
    assert len(re.findall(r'src="data:image/jpeg', text)) == 2 + 3


def test_a_sheet_that_is_too_large_shows_some_of_the_samples(overview, dataset, monkeypatch):
    monkeypatch.setattr("drapeline.report.overview._SHEET_BYTES", 5_000)
    text = overview(dataset, size=(480, 640))
    shown = text.count("<figure>")
    assert 0 < shown < 4
    assert f"{shown} of 4" in text


def test_without_accepted_samples_there_is_a_page(overview, rejected):
    shown = numbers(overview(rejected))
    assert shown["Samples"] == ("0 of 1", "accepted")
    assert "Frames" not in shown


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(InputError, match=r"status.tsv: no such file"):
        write_overview(tmp_path / "x.html", tmp_path, {})
    with pytest.raises(InputError, match=r"r.tsv: no such file"):
        write_errors(tmp_path / "x.html", tmp_path / "r.tsv", tmp_path / "m.tsv")
