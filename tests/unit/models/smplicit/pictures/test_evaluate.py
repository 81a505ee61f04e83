from dataclasses import replace

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.models.pictures.dressed import FittedGarment
from drapeline.models.pictures.known import take_pictures
from drapeline.models.pictures.read import CLASSES
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.pictures.evaluate import (
    PictureEvaluation,
    join_people,
    measure_outfit,
    silhouette_iou,
)
from drapeline.models.smplicit.settings import FitImage, Meshing
from drapeline.outfits.worn import DrapedSheet
from toys.gallery import TubeField, save_toy_model, training_codes
from toys.metric_rows import find_value
from toys.tiny_sample import write_tiny_sample

QUICK = FitImage(points=20000, rays=20, starts=3, rounds=1, steps=2)
SETTINGS = {"count": 2, "size_px": 64}


@pytest.fixture(scope="module")
def models(tmp_path_factory, toy_body):
    folder = tmp_path_factory.mktemp("models") / "skirt"
    save_toy_model(folder, toy_body, training_codes())
    return {"skirt": SmplicitModel(folder)}


@pytest.fixture(scope="module")
def tiny(tmp_path_factory, toy_body):
    return write_tiny_sample(tmp_path_factory.mktemp("stages"), toy_body)


@pytest.fixture(scope="module")
def pictures(models, tiny):
    return take_pictures([tiny.folder], models["skirt"].bodies, ["skirt"], **SETTINGS, seed=3)


def outfit_of(meshes):
    return {name: FittedGarment(np.zeros(18), mesh, mesh) for name, mesh in meshes.items()}


def test_the_truth_measures_as_such(pictures):
    for known in pictures:
        worn = outfit_of(known.true)
        rows = measure_outfit(
            known, {name: one._replace(sheet=known.rest[name]) for name, one in worn.items()}
        )
        assert set(rows) == {"upper", "skirt"}
        for row in rows.values():
            assert row["silhouette_iou"] == 1
            assert row["segmentation_accuracy"] == 1
            assert row["surface_to_true_mm"] == pytest.approx(0, abs=0.01)
            assert row["true_to_surface_mm"] == pytest.approx(0, abs=0.01)
            assert row["rest_to_true_mm"] == pytest.approx(0, abs=0.01)
            assert row["true_to_rest_mm"] == pytest.approx(0, abs=0.01)


def test_a_shifted_garment_measures_worse(pictures):
    known = pictures[0]
    skirt = known.true["skirt"]
    moved = Mesh(skirt.vertices - np.array([0, 0, 0.05], np.float32), skirt.faces)
    row = measure_outfit(known, outfit_of({"skirt": moved}))["skirt"]
    assert row["silhouette_iou"] < 0.97
    assert row["segmentation_accuracy"] < 1
    assert 1 < row["surface_to_true_mm"] <= 50


def test_of_two_people_the_first_hides_the_second(pictures):
    front, behind = (known.picture for known in pictures)
    joined = join_people(front, behind, least_px=1)
    size = SETTINGS["size_px"]
    aside = joined.classes.shape[1] - size
    assert 0 < aside < size
    assert np.array_equal(
        joined.classes[:, :size][front.classes > 0], front.classes[front.classes > 0]
    )
    seen = np.pad(front.classes == 0, ((0, 0), (0, aside)), constant_values=True)[:, aside:]
    assert (behind.classes[~seen] > 0).any()  # something is hidden
    assert np.array_equal(joined.classes[:, aside:][seen], behind.classes[seen])
    first, second = joined.people
    assert np.array_equal(first.own, ~first.others)
    assert np.array_equal(second.own, ~second.others)
    assert not (first.others & second.others).any()
    assert np.array_equal(first.others | second.others, joined.classes > 0)
    # Where a camera sees a point, there it is in the joined picture.
    point = pictures[1].body.posed[:1]
    (alone,), _ = behind.people[0].camera.project(point)
    (there,), _ = second.camera.project(point)
    assert there == pytest.approx(alone + [aside, 0])
    assert first.camera.project(point)[0] == pytest.approx(front.people[0].camera.project(point)[0])
    assert (second.camera.width, second.camera.height) == joined.classes.shape[::-1]


def test_garments_that_show_too_few_pixels_are_not_looked_for(pictures):
    behind, size = pictures[1].picture, SETTINGS["size_px"]
    wall = np.ones_like(behind.classes)
    wall[:, 3 * size // 4 :] = 0
    wall = replace(behind, classes=wall)

    def skirt(front):
        joined = join_people(front, behind, least_px=1)
        return int((joined.classes[joined.people[1].own] == CLASSES.index("skirt")).sum())

    shown = skirt(wall)
    assert 0 < shown < (behind.classes == CLASSES.index("skirt")).sum()
    for least_px in (0, 1, shown, shown + 1):
        first, second = join_people(wall, behind, least_px=least_px).people
        assert first.garments == ()
        assert second.garments == (() if least_px > shown else ("skirt",))
    everywhere = replace(wall, classes=np.ones_like(wall.classes))
    assert join_people(everywhere, behind, least_px=0).people[1].garments == ()


def test_iou_counts_pixels():
    skirt = CLASSES.index("skirt")
    found, true = np.zeros((4, 4), np.uint8), np.zeros((4, 4), np.uint8)
    found[:2], true[1:3] = skirt, skirt
    assert silhouette_iou(found, true, "skirt") == pytest.approx(4 / 12)
    assert silhouette_iou(found, true, "dress") == 0


@pytest.fixture(scope="module")
def evaluated(models, pictures):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
        evaluation = PictureEvaluation(
            models, fit=QUICK, meshing=Meshing(cell_m=0.03, threshold_m=0.018), seed=0
        )
        yield evaluation.run(pictures, "test")


@pytest.mark.portable
def test_what_is_found_stands_beside_the_mean_and_the_nearest(evaluated):
    rows, _ = evaluated
    names = ("fitted", "fitted_in_pair", "nearest", "mean_code")
    variants = {f"smplicit_images_{name}" for name in names}
    assert set(rows["variant"]) == variants
    assert set(rows["garment"]) >= {"Skirt"}
    assert set(rows["split"]) == {"test"}
    of = {(row.variant, row.metric) for row in rows.itertuples()}
    for variant in variants:
        assert (variant, "silhouette_iou") in of
        better = (variant, "better_than_mean_share") in of
        assert better == (variant != "smplicit_images_mean_code")
        assert ((variant, "fit_s") in of) == (variant == "smplicit_images_fitted")


@pytest.mark.portable
def test_what_is_shown_is_what_was_found(evaluated, pictures):
    _, shown = evaluated
    for picture, known in zip(shown, pictures, strict=True):
        assert picture.name == known.picture.name
        (person,) = picture.people
        assert set(person.garments) == {"Skirt"}
        assert set(person.true) == {"Tshirt", "Skirt"}


@pytest.mark.portable
def test_hung_garments_stand_beside_the_mean_code_hung_as_well(models, pictures, monkeypatch):
    monkeypatch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
    far = np.array([0, 0, 3.0], np.float32)
    draped = []

    def hang(sheets, *others):
        draped.append(list(sheets))
        shift = far if len(draped) % 4 else 0 * far  # the mean code is the fourth of a picture
        return {
            name: DrapedSheet(sheet, Mesh(sheet.vertices + shift, sheet.faces))
            for name, sheet in sheets.items()
        }

    evaluation = PictureEvaluation(
        models, fit=QUICK, meshing=Meshing(cell_m=0.03, threshold_m=0.018), seed=0, draper=hang
    )
    rows, shown = evaluation.run(pictures, "test")
    assert draped == 4 * len(pictures) * [["Skirt"]]

    def value(variant, metric):
        return find_value(rows, f"smplicit_images_{variant}", "test", "Skirt", metric)

    # Out of sight, it is worse than the mean code in its place.
    assert value("hung", "silhouette_iou").value == 0
    assert value("hung", "better_than_mean_share").value == 0
    assert value("nearest_hung", "better_than_mean_share").value == 0
    assert value("nearest", "silhouette_iou").value > value("nearest_hung", "silhouette_iou").value
    assert value("mean_code_hung", "silhouette_iou").value > 0
    assert value("mean_code_hung", "better_than_mean_share") is None
    assert value("hung", "fit_s").value >= value("fitted", "fit_s").value
    for picture in shown:
        assert picture.people[0].garments["Skirt"].vertices[:, 2].min() > 1


def test_pictures_without_garments_are_refused(models, tiny):
    other = {"trousers": models["skirt"]}
    pictures = take_pictures(
        [tiny.folder], models["skirt"].bodies, ["trousers"], **SETTINGS, seed=3
    )
    evaluation = PictureEvaluation(
        other, fit=QUICK, meshing=Meshing(cell_m=0.03, threshold_m=0.018), seed=0
    )
    with pytest.raises(InputError, match="no picture of the val split .* the models trousers"):
        evaluation.run(pictures, "val")
