"""Codes from pictures: learned, measured, drawn, and used on a picture of one's own, on toys."""

import csv
import json

import numpy as np
import pytest
from PIL import Image

from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.obj import load_obj
from drapeline.learning_data.static import CONDITIONS
from drapeline.metrics.predictions import load_fitted_picture, load_fitted_scans
from drapeline.metrics.table import read_metrics
from drapeline.models.gcvae.pictures.model import PictureModel
from drapeline.models.gcvae.pictures.network import load_coder
from drapeline.models.gcvae.vae import StaticVae
from drapeline.report.models.gcvae.pictures import GARMENTS_AT_REST, PICTURES, load_pictures
from toys.gcvae_files import SETTINGS, save_model, shaken, template_on_body, torso_registration
from toys.pictured import HANGING, VIEWS, save_toy_pictures
from toys.smplicit import toy_bodies
from toys.tiny_sample import write_tiny_sample

VARIANTS = ("network", "nearest", "untrained", "mean_code", "mean_garment", "registered")


@pytest.fixture(scope="module")
def files(tmp_path_factory, toy_body, run_rule):
    """All that a network learns from, and the network after a few steps."""
    folder = tmp_path_factory.mktemp("pictured")
    files = save_toy_pictures(folder, toy_body)
    files["network"] = folder / "network"
    run_rule(
        "drapeline.models.gcvae.pictures.train:train",
        input={name: files[name] for name in ("model", "data", "pictures")},
        output=[files["network"]],
        params={
            "settings": {"width": 2, "training": {"steps": 4, "batch": 4}},
            "trainer": {"accelerator": "cpu", "devices": 1},
            "progress": str(folder / "progress"),
        },
    )
    return files


@pytest.fixture(scope="module")
def evaluated(files, toy_body, run_rule):
    """The evaluation of two pictures of two test samples in a t-shirt and a skirt."""
    folder = files["data"].parent
    for name in ("00001", "00002"):
        sample = write_tiny_sample(folder, toy_body, name, "test", seed=int(name))
        registered = folder / "registrations" / name
        registered.mkdir(parents=True)
        torso_registration(toy_body, sample.shape).save(registered / "Skirt.npz")
    bodies = ("female", "male", "network", "model", "data", "pictures")
    run_rule(
        "drapeline.models.gcvae.pictures.evaluate:evaluate",
        input={
            **{name: files[name] for name in bodies},
            "samples": [folder / "samples"],
            "registrations": [folder / "registrations"],
        },
        output=[folder / "evaluated"],
        params={
            "split": "test",
            "samples": ["00001"],
            "pictures": 2,
            "others": ["00002"],
            "size_px": 64,
            "picture_seed": 0,
            "seed": 0,
        },
    )
    return folder / "evaluated"


def test_the_network_keeps_what_its_codes_were_made_with(files, toy_body):
    coder = load_coder(files["network"])
    assert coder.size_px == VIEWS.size_px
    model = PictureModel(files["network"], files["model"], toy_bodies(toy_body))
    assert model.known == ["skirt"]


def test_another_static_model_than_that_of_the_training_is_refused(files, toy_body, tmp_path):
    other = shaken(shaken(StaticVae(SETTINGS, template_on_body(toy_body, CONDITIONS))))
    save_model(tmp_path / "other", other)
    with pytest.raises(InputError, match="has learned the codes of another model than .*other"):
        PictureModel(files["network"], tmp_path / "other", toy_bodies(toy_body))


def test_every_row_is_of_the_same_garments_at_rest(evaluated):
    rows = read_metrics(evaluated / "metrics.tsv")
    assert set(rows["variant"]) == {f"picture_{name}" for name in VARIANTS}
    # The t-shirt is of a class that was not learned.
    assert set(rows["garment"]) == {"all", "Skirt"}
    assert {"rest_to_true_mm", "true_to_rest_mm"} <= set(rows["metric"])
    assert set(rows["n"]) == {3}


def test_what_is_drawn_is_what_was_measured(evaluated):
    pictures = load_pictures(evaluated / PICTURES)
    found = load_fitted_scans(evaluated / GARMENTS_AT_REST)
    assert [one.name for one in pictures] == list(found)
    for picture in pictures:
        assert picture.segments.shape == picture.labels.shape == (64, 64)
        # Segments are those of the skin that is seen.
        assert ((picture.segments > 0) == (picture.labels == 1)).mean() > 0.99
        fits = found[picture.name]
        assert set(VARIANTS) <= set(fits)
        assert len(fits["true"]["Skirt"].faces)


def test_a_sheet_has_a_row_for_each_picture_that_is_wanted(evaluated, run_rule, tmp_path):
    def height(most):
        run_rule(
            "drapeline.report.models.gcvae.pictures:plot_evaluated",
            input={"evaluated": evaluated, "fitted": tmp_path},
            output=[tmp_path / "sheet.png"],
            params={"most": most, "rays": 0.02},
        )
        with Image.open(tmp_path / "sheet.png") as image:
            return image.height

    assert height(2) > 1.6 * height(1)


def write_picture(folder, labels):
    values = np.zeros((120, 120), np.uint8)
    values[60:85, 40:80] = 12
    Image.fromarray(values).save(folder / "labels.png")
    person = {
        "gender": "female",
        "shape": [0.0] * 10,
        "pose": REST_POSE.tolist(),
        "trans": [0.0, 0.0, 0.0],
    }
    to_camera = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 2.5], [0, 0, 0, 1]]
    given = {
        "segmentation": "labels.png",
        "labels": labels,
        "camera": {"focal_px": 150.0, "world_to_camera": to_camera},
        "people": [person],
    }
    (folder / "street.json").write_text(json.dumps(given))
    return folder / "street.json"


def regress(run_rule, files, picture, made, hang_frames=0):
    run_rule(
        "regress_picture",
        input={
            "picture": picture,
            "images": [picture.parent / "labels.png"],
            **{name: files[name] for name in ("female", "male", "network", "model")},
        },
        output={"folder": made / "street", "shown": made / "street_shown.npz"},
        params={"least_px": 50, "hang_frames": hang_frames, **HANGING},
        wildcards={"picture": "street"},
    )


@pytest.mark.portable
@pytest.mark.parametrize("hang_frames", [0, 1])
def test_a_users_picture_gets_its_garments(run_rule, files, tmp_path, hang_frames):
    regress(run_rule, files, write_picture(tmp_path, "lip"), tmp_path, hang_frames)
    with open(tmp_path / "street/garments.tsv") as stream:
        (row,) = csv.DictReader(stream, delimiter="\t")
    assert (row["person"], row["garment"], row["pixels"]) == ("1", "skirt", "1000")
    rest, posed = (load_obj(tmp_path / f"street/person1_skirt{end}.obj") for end in ("_rest", ""))
    assert np.array_equal(rest.faces, posed.faces)
    assert len(rest.vertices) == int(row["vertices"])
    assert np.load(tmp_path / "street/codes.npz")["person1_skirt"].shape == (5,)
    (person,) = load_fitted_picture(tmp_path / "street_shown.npz").people
    assert set(person.garments) == set(person.rest) == {"Skirt"}


def test_a_picture_of_garments_that_were_not_learned_is_refused(run_rule, files, tmp_path):
    picture = write_picture(tmp_path, {"0": "background", "12": "dress"})
    with pytest.raises(SystemExit, match="street: shows a garment of the class dress, expected"):
        regress(run_rule, files, picture, tmp_path)
    assert not (tmp_path / "street").exists()
