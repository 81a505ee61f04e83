"""Trained models as drapeline brings them: half as large, and loaded by their names."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from drapeline.errors import InputError
from drapeline.metrics.table import write_metrics
from drapeline.models.gcvae.ppca import StaticPpca
from drapeline.models.gcvae.settings import PpcaSettings
from drapeline.models.load import load
from drapeline.models.package import CARD, card, pack_model, pack_models
from drapeline.models.registry import Package
from drapeline.models.training.checkpoints import SMALL
from drapeline.models.training.module import BEST
from drapeline.report.tables import read_test_metrics
from drapeline.storage import load_npz, save_npz
from toys.gcvae import toy_template
from toys.gcvae_files import SETTINGS, TypedGarments, save_model
from toys.jobs import job_of
from toys.metric_rows import metric_row, metric_table

WEARER = {"gender": "female", "shape": np.zeros(10), "tightness": np.zeros(2)}
CODES = np.linspace(-1, 1, 3 * SETTINGS.network.latent).reshape(3, -1)


@pytest.fixture
def weights(tmp_path, monkeypatch) -> Path:
    """The folder of the models that come with drapeline, which has none yet."""
    monkeypatch.setattr("drapeline.models.start.package_files", lambda name: tmp_path / name)
    return tmp_path / "drapeline" / "weights"


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("trained") / "svae"
    save_model(folder, garments=TypedGarments())
    return folder


@pytest.fixture
def large_toys(monkeypatch):
    """Tensors of toys count as large ones, which alone are stored in half precision."""
    for module in ("models.package", "models.training.checkpoints"):
        monkeypatch.setattr(f"drapeline.{module}.SMALL", 20)


def size(folder):
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def test_a_packed_model_is_found_by_its_name_and_gives_nearly_the_same(
    trained, weights, large_toys
):
    pack_model(trained, weights / "rest" / "toy")
    assert size(weights) < 0.7 * size(trained)
    whole, packed = load(trained), load("rest/toy")
    assert packed.folder == weights / "rest" / "toy"
    assert (packed.latent, packed.garments) == (whole.latent, whole.garments)
    for one, other in zip(
        *(model.decode(CODES, "Dress", **WEARER) for model in (whole, packed)), strict=True
    ):
        away, _ = KDTree(one.mesh.vertices).query(other.mesh.vertices)
        assert 0 < away.mean() < 1e-3
        assert len(other.mesh.faces) == pytest.approx(len(one.mesh.faces), rel=0.05)


@pytest.fixture
def folder(trained, tmp_path) -> Path:
    """A trained model whose other files are still to be written."""
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / BEST).write_bytes((trained / BEST).read_bytes())
    return tmp_path / "model"


def test_large_arrays_are_stored_in_16_bits_and_all_others_as_they_are(folder, tmp_path):
    arrays = {
        "large": np.linspace(-7, 8, SMALL).reshape(100, -1),
        "unknown": np.full(SMALL, np.nan, dtype=np.float32),
        "small": np.linspace(-7, 8, SMALL - 1),
        "whole": np.arange(SMALL, dtype=np.int32),
        "names": np.array(["s00001", "s00002"]),
    }
    (folder / "bodies").mkdir()
    save_npz(folder / "bodies" / "codes.npz", **arrays)
    pack_model(folder, tmp_path / "packed")
    path = tmp_path / "packed" / "bodies" / "codes.npz"
    with np.load(path) as stored:
        halved = {name for name in stored.files if stored[name].dtype == np.float16}
    assert halved == {"large", "unknown"}
    found = load_npz(path, {"*": "any|nan ..."})
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        if name in halved:
            array = array.astype(np.float16).astype(np.float32)
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


def test_what_a_training_leaves_besides_its_model_is_not_packed(folder, tmp_path):
    (folder / "history.tsv").write_text("step\n")
    pack_model(folder, tmp_path / "packed")
    assert {path.name for path in (tmp_path / "packed").rglob("*")} == {BEST}


def test_a_name_that_is_none_is_refused_with_those_that_are(trained, weights):
    sentence = "nothing: no such folder, expected that of a trained model, "
    with pytest.raises(InputError, match=f"{sentence}and this copy comes with no models"):
        load("nothing")
    for name in ("b/second", "first"):
        pack_model(trained, weights / name)
    with pytest.raises(InputError, match=f"{sentence}or one of b/second, first$"):
        load("nothing")
    for name in ("b", "../weights/first"):
        with pytest.raises(InputError, match=f"{name}: no such folder"):
            load(name)


def test_a_folder_of_the_same_name_comes_first(trained, weights, tmp_path, monkeypatch):
    pack_model(trained, weights / "toy")
    monkeypatch.chdir(tmp_path)
    garments = TypedGarments()
    other = StaticPpca(PpcaSettings(latent=4), toy_template())
    other.fit(garments)
    save_model(tmp_path / "toy", other.eval(), garments)
    assert load("toy").latent == 4
    (tmp_path / "toy").rename(tmp_path / "elsewhere")
    assert load("toy").latent == SETTINGS.network.latent


def test_a_number_that_half_precision_does_not_hold_is_named(folder, tmp_path):
    large = np.full(SMALL, 0.5)
    large[7] = -1e6
    save_npz(folder / "codes.npz", mean=large)
    with pytest.raises(
        InputError, match=r"codes\.npz: 'mean' is up to 1e\+06, expected at most 65504"
    ):
        pack_model(folder, tmp_path / "packed")
    save_npz(folder / "codes.npz", mean=large[1:])
    pack_model(folder, tmp_path / "packed")


def test_what_is_no_trained_model_cannot_be_packed(tmp_path):
    with pytest.raises(InputError, match=f"{BEST}: no such file"):
        pack_model(tmp_path / "nothing", tmp_path / "packed")


# ---- cards

PACKAGE = Package(
    folder="results/ppca",
    title="Garments at rest as codes",
    use='skirts = model.sample(8, "Skirt")',
    models=("ppca", "baseline"),
    variants=("static_ppca", "mean_garment"),
    metrics=("surface_error_mm", "mask_iou"),
    garments=("Skirt", "Dress", "Trousers"),
)
ABOUT = {
    "commit": "abc1234",
    "seed": 3,
    "samples": {
        split: {"sequences": 7 + k, "outfits at rest": 40 + k}
        for k, split in enumerate(("train", "val", "test"))
    },
    "clips": {"train": ["jump", "walk"], "val": ["spin"], "test": []},
    "learned": ["00001", "s00001"],
    "config": "mine.yaml",
    "body_files": [],
}


def metrics_of(path, *rows):
    """What a card is written from, of (model, variant, garment, metric, value, low, high)."""
    ends = ("", "_low95", "_high95")
    table = metric_table(
        metric_row(variant, garment, metric + end, value, model=model)
        for model, variant, garment, metric, *values in rows
        for end, value in zip(ends, values, strict=True)
    )
    write_metrics(path, table)
    return read_test_metrics(path)


def tables_of(text):
    """All tables of a page in Markdown: rows of cells, by the heading of the section."""
    return {
        part.partition("\n")[0]: [
            [cell.strip() for cell in line.strip("|").split("|")]
            for line in part.splitlines()
            if line.startswith("| ") and "---" not in line
        ]
        for part in text.split("\n## ")
    }


def test_a_card_says_what_a_model_is_has_learned_and_can(tmp_path):
    metrics = metrics_of(
        tmp_path / "metrics.tsv",
        ("ppca", "static_ppca", "all", "surface_error_mm", 12.5, 11.0, 14.0),
        ("ppca", "static_ppca", "Skirt", "surface_error_mm", 8.0, 7.0, 9.0),
        ("baseline", "mean_garment", "all", "surface_error_mm", 40.0, 30.0, 50.0),
        ("svae", "static_ppca", "all", "surface_error_mm", 77.0, 76.0, 78.0),
        ("ppca", "dynamic_ppca", "all", "surface_error_mm", 66.0, 65.0, 67.0),
        ("ppca", "static_ppca", "all", "normal_error_deg", 55.0, 54.0, 56.0),
    )
    text = card("rest/toy", PACKAGE, ABOUT, metrics)
    assert text.startswith("# rest/toy\n\nGarments at rest as codes, by drapeline")
    assert f'model = drapeline.load("rest/toy")\n{PACKAGE.use}\n' in text
    assert "skirts, dresses and trousers, on bodies" in text
    assert "`mine.yaml`, at commit abc1234, with the seed 3:" in text
    tables = tables_of(text)
    assert tables["Data"] == [
        ["split", "sequences", "outfits at rest", "clips"],
        ["train", "7", "40", "jump, walk"],
        ["val", "8", "41", "spin"],
        ["test", "9", "42", ""],
    ]
    heading, *rows = tables["On the test split"]
    column = heading.index("Surface error (mm)")
    assert [[row[heading.index("Garment")], row[column]] for row in rows] == [
        ["Skirt", "8.0 [7.0, 9.0]"],
        ["All", "12.5 [11.0, 14.0]"],
        ["All", "40.0 [30.0, 50.0]"],
    ]
    for number in ("77.0", "66.0", "55.0"):
        assert number not in text
    assert "Apache-2.0" in text.partition("## Licence")[2]


def test_a_card_of_one_garment_type_says_it_once(tmp_path):
    metrics = metrics_of(
        tmp_path / "metrics.tsv",
        ("ppca", "static_ppca", "all", "surface_error_mm", 8.0, 7.0, 9.0),
        ("ppca", "static_ppca", "Skirt", "surface_error_mm", 8.0, 7.0, 9.0),
    )
    text = card("toy", PACKAGE._replace(garments=("Skirt",)), ABOUT, metrics)
    assert "It knows skirts, on" in text
    assert text.count("8.0 [7.0, 9.0]") == 1


def test_a_model_without_rows_still_has_a_card(tmp_path):
    text = card("toy", PACKAGE, ABOUT, metrics_of(tmp_path / "metrics.tsv"))
    assert "# toy" in text
    assert len(tables_of(text)["Data"]) == 4
    assert "(none)" in text.partition("## On the test split")[2]


def test_every_model_that_comes_along_is_packed_with_its_card(trained, weights, tmp_path):
    metrics_of(
        tmp_path / "metrics.tsv",
        ("ppca", "static_ppca", "all", "surface_error_mm", 12.5, 11.0, 14.0),
    )
    told = PACKAGE._replace(folder=str(trained))._asdict()
    packages = {"toy": told, "rest/toy": {**told, "models": ["svae"]}}
    given = {"metrics": tmp_path / "metrics.tsv"}
    pack_models(job_of(given, weights, models=packages, about=ABOUT))
    for name in packages:
        assert load(name).latent == SETTINGS.network.latent
        assert (weights / name / CARD).read_text().startswith(f"# {name}\n")
    assert "12.5 [" in (weights / "toy" / CARD).read_text()
    assert "12.5 [" not in (weights / "rest/toy" / CARD).read_text()


def test_models_of_bodies_of_ones_own_are_not_packed(trained, weights, tmp_path):
    """Their licence is not ours to give on."""
    packages = {"toy": PACKAGE._replace(folder=str(trained))._asdict()}
    about = {**ABOUT, "body_files": ["bodies/SMPL_FEMALE.pkl", "bodies/SMPL_MALE.pkl"]}
    metrics_of(tmp_path / "metrics.tsv")
    given = {"metrics": tmp_path / "metrics.tsv"}
    sentence = "body.files names bodies/SMPL_FEMALE.pkl, bodies/SMPL_MALE.pkl, whose licence"
    with pytest.raises(InputError, match=sentence):
        pack_models(job_of(given, weights, models=packages, about=about))
    assert not weights.exists()
