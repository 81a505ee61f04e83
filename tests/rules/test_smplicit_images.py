"""The rules that find garments in pictures, on a model whose sheets are exact tubes."""

import csv
import json

import numpy as np
import pytest
from PIL import Image

from drapeline.frames import REST_POSE
from drapeline.geometry.obj import load_obj
from drapeline.metrics.predictions import load_fitted_picture
from toys.pictured import HANGING
from toys.tiny_sample import write_tiny_sample

SIZE = 120
TO_CAMERA = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 2.5], [0, 0, 0, 1]]
FIT = {"points": 20000, "rays": 20, "starts": 3, "rounds": 1, "steps": 2}
MESHING = {"cell_m": 0.03, "threshold_m": 0.018}


@pytest.fixture
def picture(tmp_path):
    labels = np.zeros((SIZE, SIZE), np.uint8)
    labels[60:85, 40:80] = 12
    Image.fromarray(labels).save(tmp_path / "labels.png")
    person = {
        "gender": "female",
        "shape": [0.0] * 10,
        "pose": REST_POSE.tolist(),
        "trans": [0.0, 0.0, 0.0],
    }
    given = {
        "segmentation": "labels.png",
        "labels": "lip",
        "camera": {"focal_px": 150.0, "world_to_camera": TO_CAMERA},
        "people": [person],
    }
    path = tmp_path / "street.json"
    path.write_text(json.dumps(given))
    return path


def fit(run_rule, picture, models, folder, **changes):
    run_rule(
        "fit_picture",
        input={"picture": picture, "images": [picture.parent / "labels.png"], "models": models},
        output={"folder": folder / "street", "shown": folder / "street_shown.npz"},
        params={"fit": FIT | changes, "meshing": MESHING, "seed": 0, **HANGING},
        wildcards={"picture": "street"},
    )


@pytest.mark.portable
def test_a_users_picture_gets_its_garments(run_rule, skirt, picture, tmp_path):
    made = tmp_path / "made"
    fit(run_rule, picture, [skirt], made)
    with open(made / "street/garments.tsv") as stream:
        (row,) = csv.DictReader(stream, delimiter="\t")
    assert (row["person"], row["garment"], row["pixels"]) == ("1", "skirt", "1000")
    rest, posed = (load_obj(made / f"street/person1_skirt{end}.obj") for end in ("_rest", ""))
    assert len(posed.vertices) == len(rest.vertices) == int(row["vertices"])
    assert len(rest.faces) == int(row["faces"]) > 0
    codes = np.load(made / "street/codes.npz")
    assert codes["person1_skirt"].shape == (18,)

    run_rule(
        "plot_fitted_picture",
        input=[made / "street_shown.npz"],
        output=[made / "street.png"],
        params={"rays": 0.02},
    )
    image = np.asarray(Image.open(made / "street.png").convert("RGB")).astype(int)
    assert (np.ptp(image, axis=2) > 25).mean() > 0.01


@pytest.mark.portable
def test_garments_hang_on_the_people_of_a_picture(run_rule, skirt, picture, tmp_path):
    vertices = []
    for frames in (0, 2):
        fit(run_rule, picture, [skirt], tmp_path / str(frames), hang_frames=frames)
        rest, posed = (
            load_obj(tmp_path / f"{frames}/street/person1_skirt{end}.obj") for end in ("_rest", "")
        )
        assert np.array_equal(rest.faces, posed.faces)
        vertices.append(len(posed.vertices))
    # The cloth that hangs is coarser.
    assert vertices[1] < 0.8 * vertices[0]
    assert np.linalg.norm(posed.vertices - rest.vertices, axis=1).max() < 0.3


def test_a_picture_of_unlearned_garments_is_refused(run_rule, skirt, picture, tmp_path):
    given = json.loads(picture.read_text())
    given["labels"] = {"0": "background", "12": "dress"}
    picture.write_text(json.dumps(given))
    with pytest.raises(SystemExit, match="drapeline: street: shows garments of the model whole"):
        fit(run_rule, picture, [skirt], tmp_path / "made")
    assert not (tmp_path / "made/street").exists()


def evaluate(run_rule, skirt, folder, samples, others):
    """Rows of the table, and names of the pictures, of samples that were written to a folder."""
    run_rule(
        "drapeline.models.smplicit.pictures.evaluate:evaluate_images",
        input={"models": [skirt], "samples": [folder / "samples"]},
        output=[folder / "evaluated"],
        params={
            "split": "test",
            "samples": samples,
            "pictures": 2,
            "others": others,
            "size_px": 48,
            "picture_seed": 0,
            "fit": FIT,
            "meshing": MESHING,
            "seed": 0,
            **HANGING,
        },
    )
    with open(folder / "evaluated/metrics.tsv") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    files = sorted((folder / "evaluated").glob("*.npz"))
    return rows, [load_fitted_picture(file).name for file in files]


@pytest.fixture
def pictured(toy_body, tmp_path):
    """Writes a test sample into a shard."""

    def write(name, **values):
        write_tiny_sample(tmp_path, toy_body, name, "test", **values)

    return write


@pytest.mark.portable
def test_pictures_of_samples_are_measured_and_drawn(run_rule, skirt, pictured, tmp_path):
    for seed, name in enumerate(("00001", "00002", "L00001", "L00002")):
        pictured(name, seed=seed)
    rows, names = evaluate(run_rule, skirt, tmp_path, ["00001", "00002"], ["L00002"])
    # A picture of each sample, and of the one of another group that was asked for.
    count = {row["variant"]: row["n"] for row in rows if row["metric"] == "silhouette_iou"}
    # Two by two, of three people one stays out.
    assert count.pop("smplicit_images_fitted_in_pair") == "2"
    assert set(count.values()) == {"3"}
    assert names == ["00001_003", "00002_003", "L00002_003"]

    def height(most):
        run_rule(
            "drapeline.report.models.smplicit.figures:plot_evaluated_pictures",
            input={"evaluated": tmp_path / "evaluated"},
            output=[tmp_path / "all.png"],
            params={"rays": 0.02, "most": most},
        )
        with Image.open(tmp_path / "all.png") as image:
            return image.height

    assert height(2) > 1.6 * height(1)


@pytest.mark.portable
def test_rejected_samples_are_not_pictured(run_rule, skirt, pictured, tmp_path):
    for name in ("00001", "L00001"):
        pictured(name, status="rejected")
    pictured("L00002")
    _, names = evaluate(run_rule, skirt, tmp_path, ["00001"], ["L00001", "L00002"])
    # Once, although two were asked for.
    assert names == ["L00002_003"]
    with pytest.raises(SystemExit, match="all 2 samples of the test split .* were rejected"):
        evaluate(run_rule, skirt, tmp_path, ["00001"], ["L00001"])
