"""Questions as files, and answers that are measured as our own are."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import drapeline
from drapeline.dataset.reader import Sample
from drapeline.errors import InputError
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.geometry.obj import load_obj, save_obj
from drapeline.learning_data.static import StaticData
from drapeline.metrics.metric import Measured
from drapeline.metrics.table import ALL, METRICS_FILE, join, read_metrics, summarise
from drapeline.models.compare import (
    MOVED,
    SCANNED,
    compare_frames,
    compare_representations,
    held_out_garments,
    known_scans,
)
from drapeline.models.contract import Stopwatch
from drapeline.models.pictures.known import pictures_of_job, rest_distances
from drapeline.models.pictures.read import CLASSES, GARMENT_CLASSES
from drapeline.models.protocol import CASES, score, write_protocol
from drapeline.models.smplicit.gallery.motion import repose
from drapeline.outfits.garment_types import LABELS
from drapeline.outfits.static import load_static
from drapeline.schema import read_table
from toys.jobs import job_of
from toys.metric_rows import find_value
from toys.protocol import SAMPLES, TOLD, save_cases
from toys.smplicit import toy_bodies, toy_outfits
from toys.tiny_sample import TIGHTNESS

QUESTIONS = ("rest", "motion", "points", "worse_points", "picture")
# Rows of which model answer them.
ROWS = {
    "rest": "representation",
    "motion": "moved",
    "points": "clean_scan",
    "worse_points": "worse_scan",
    "picture": "picture",
}


class Asked:
    """A protocol, and what it was written from."""

    def __init__(self, folder, body, window):
        self.given, self.body = save_cases(folder, body, window), body
        self.folder = folder / "protocol"
        write_protocol(job_of(self.given, self.folder, **TOLD))
        table = read_table(self.folder / "cases.tsv", CASES)
        self.cases = [(row.question, row.case, row.garment) for row in table.itertuples()]

    def score(self, answers):
        """Rows of metrics of a folder of answers."""
        out = answers.parent / f"{answers.name} scored"
        score(job_of(self.given, out, predictions=str(answers), **TOLD))
        return read_metrics(out / METRICS_FILE)

    def arrays(self, question, case):
        """All arrays that a case comes with, by file and name."""
        found = {}
        for path in (self.folder / question / case).glob("*.npz"):
            with np.load(path) as arrays:
                found |= {f"{path.name}/{name}": arrays[name] for name in arrays.files}
        return found

    def scans(self, kind):
        files = [self.given["samples"][0] / name for name in SAMPLES]
        return known_scans(self.given[f"{kind}_scans"], files, toy_bodies(self.body))

    def true(self, question, case, garment):
        """What answers it, in the world that is asked for."""
        if question == "rest":
            (outfit,) = (one.outfit for one in toy_outfits() if one.name == case)
            (made,) = outfit.garments
            return Mesh(made.vertices, triangulate(made.faces))
        name, frame = case.split("_")
        with Sample(self.given["samples"][0] / name) as sample:
            mesh, frame = sample.mesh(garment), int(frame)
            if question != "picture":
                (cloth,) = sample.vertices(garment, frame, frame + 1, "world")
                mesh = Mesh(cloth, mesh.faces)
        return Mesh(mesh.vertices, mesh.triangles)


@pytest.fixture(scope="module")
def asked(tmp_path_factory, toy_body):
    return Asked(tmp_path_factory.mktemp("asked"), toy_body, window=3)


def answer(folder, asked, mesh_of, questions=QUESTIONS):
    """A folder of answers, of what `mesh_of(question, case, garment)` gives."""
    for question, case, garment in asked.cases:
        if question in questions:
            save_obj(folder / question / case / f"{garment}.obj", mesh_of(question, case, garment))
    return folder


@pytest.fixture(scope="module")
def truth(asked, tmp_path_factory):
    return answer(tmp_path_factory.mktemp("answers") / "truth", asked, asked.true)


# ---- what is asked ----------------------------------------------------------------------------


def test_every_question_is_asked_of_every_held_out_garment(asked):
    found = {
        question: {one[1:] for one in asked.cases if one[0] == question} for question in QUESTIONS
    }
    assert found["rest"] == {("s6", "Skirt"), ("s7", "Skirt")}
    frames = {f"{name}_{frame:03d}" for name in SAMPLES for frame in (1, 4)}
    both = {(case, garment) for case in frames for garment in ("Skirt", "Tshirt")}
    assert found["motion"] == found["points"] == both
    middles = {(f"{name}_003", garment) for name in SAMPLES for garment in ("Skirt", "Tshirt")}
    assert found["worse_points"] == middles
    assert {case.split("_")[0] for case, _ in found["picture"]} == {"00001", "00002"}
    for question, case, _ in asked.cases:
        assert any((asked.folder / question / case).iterdir())
    folders = {path.relative_to(asked.folder).parts for path in asked.folder.glob("*/*/")}
    assert folders - {("bodies",)} == {one[:2] for one in asked.cases}


def test_no_file_tells_where_cloth_is_that_is_asked_for(asked):
    """Of points, poses and pixels alone; and of garments in motion how they are at rest."""
    told = {"gender", "shape", "poses", "trans"}
    seen = {*told, "points", "labels", "label_names"}
    pictured = {"pixels", "label_names", "intrinsics", "world_to_camera", "pose", "trans"}
    keys = {
        "rest": {f"wearer.npz/{name}" for name in ("gender", "shape", "tightness")},
        "motion": {f"wearer.npz/{name}" for name in (*told, "tightness")},
        "points": {f"scan.npz/{name}" for name in seen},
        "worse_points": {f"scan.npz/{name}" for name in seen},
        "picture": {f"picture.npz/{name}" for name in pictured | {"gender", "shape"}},
    }
    for question, case, garment in asked.cases:
        assert asked.arrays(question, case).keys() == keys[question]
        meshes = {path.stem for path in (asked.folder / question / case).glob("*.obj")}
        if question not in ("rest", "motion"):
            assert not meshes
            continue
        assert garment in meshes
        shown = load_obj(asked.folder / question / case / f"{garment}.obj")
        at_rest = asked.true("rest" if question == "rest" else "picture", case, garment)
        np.testing.assert_allclose(shown.vertices, at_rest.vertices, atol=1e-6)


def test_the_tightness_is_what_the_shape_is_changed_by(asked):
    """For a woman, the first of two numbers is taken off it."""
    data = StaticData(asked.given["data"])
    registered = dict(zip(data.outfit.tolist(), data.tightness, strict=True))
    for question, case, _ in asked.cases:
        told = asked.arrays(question, case)
        if question == "rest":
            np.testing.assert_array_equal(told["wearer.npz/tightness"], registered[case])
        elif question == "motion":
            assert told["wearer.npz/gender"] == "female"
            assert told["wearer.npz/tightness"].tolist() == [-TIGHTNESS[0], TIGHTNESS[1]]


def test_a_motion_of_a_sample_without_tightness_is_asked_about(asked, tmp_path, monkeypatch):
    def untold(*given):
        known = known_scans(*given)
        return [one._replace(person=one.person._replace(tightness=None)) for one in known]

    monkeypatch.setattr("drapeline.models.protocol.known_scans", untold)
    write_protocol(job_of(asked.given, tmp_path / "protocol", **TOLD))
    with np.load(tmp_path / "protocol/motion/00001_001/wearer.npz") as wearer:
        assert {*wearer.files} == {"gender", "shape", "poses", "trans"}


def test_poses_of_a_motion_end_with_the_frame_that_is_asked_for(asked):
    for question, case, _ in asked.cases:
        if question == "motion":
            told, frame = asked.arrays(question, case), int(case.split("_")[1])
            with Sample(asked.given["samples"][0] / case.split("_")[0]) as sample:
                for name in ("poses", "trans"):
                    true = getattr(sample.info, name)[: frame + 1]
                    np.testing.assert_allclose(told[f"wearer.npz/{name}"], true, atol=1e-6)


def assert_points_are_on_the_cloth(asked, far_m):
    """Those of the middle frame that are labelled so, in the world of the answer."""
    for question, case, garment in asked.cases:
        if question == "points":
            told = asked.arrays(question, case)
            middle = len(told["scan.npz/points"]) // 2
            names = told["scan.npz/label_names"].tolist()
            assert names == [*LABELS]
            own = told["scan.npz/labels"][middle] == names.index(garment)
            cloth, true = told["scan.npz/points"][middle][own], asked.true(question, case, garment)
            place, _ = closest_points(cloth, true.vertices, true.faces)
            assert np.linalg.norm(place - cloth, axis=1).max() < far_m


def test_points_are_in_the_world_of_the_answer(asked):
    assert_points_are_on_the_cloth(asked, 1e-4)


def test_scans_of_single_frames_are_windows_of_one(tmp_path, toy_body):
    alone = Asked(tmp_path, toy_body, window=1)
    assert_points_are_on_the_cloth(alone, 1e-4)
    for known in alone.scans("worse"):
        told = alone.arrays("worse_points", known.scan.name)
        assert [len(told[f"scan.npz/{name}"]) for name in ("points", "poses", "trans")] == [1] * 3
        root = known.person.trans[-1]
        np.testing.assert_allclose(told["scan.npz/points"][0] - root, known.scan.points, atol=1e-6)
        np.testing.assert_allclose(told["scan.npz/trans"][0] - root, known.body.trans, atol=1e-6)


def test_pixels_are_labelled_by_name(asked):
    for question, case, garment in asked.cases:
        if question == "picture":
            told = asked.arrays(question, case)
            names = told["picture.npz/label_names"].tolist()
            kind = {"Skirt": "skirt", "Tshirt": "upper"}[garment]
            assert names == [*CLASSES]
            assert (told["picture.npz/pixels"] == names.index(kind)).any()


def test_a_picture_in_which_no_garment_is_seen_is_not_asked_about(asked, tmp_path, monkeypatch):
    """And leaves those of others as they are."""
    pictures = "drapeline.models.protocol.pictures_of_job"

    def some_bare(*given):
        first, *others = pictures_of_job(*given)
        person = replace(others[0].person, garments=())
        return [first, replace(others[0], picture=replace(others[0].picture, people=(person,)))]

    monkeypatch.setattr(pictures, some_bare)
    write_protocol(job_of(asked.given, tmp_path / "protocol", **TOLD))
    (folder,) = (tmp_path / "protocol/picture").iterdir()
    expected = asked.arrays("picture", folder.name)
    with np.load(folder / "picture.npz") as arrays:
        for name in arrays.files:
            np.testing.assert_array_equal(arrays[name], expected[f"picture.npz/{name}"])


@pytest.mark.parametrize("left", ["samples", "others", None])
def test_pictures_are_of_all_samples_that_there_are(asked, tmp_path, left):
    told = {**TOLD, **{name: [] for name in ("samples", "others") if name != left}}
    write_protocol(job_of(asked.given, tmp_path / "protocol", **told))
    cases = read_table(tmp_path / "protocol/cases.tsv", CASES)
    found = {case.split("_")[0] for case in cases["case"][cases["question"] == "picture"]}
    assert found == ({TOLD[left][0]} if left else set())


# ---- what is answered -------------------------------------------------------------------------


def test_the_truth_is_measured_as_such_in_every_question(asked, truth):
    rows = asked.score(truth)
    assert {*rows["model"]} == {*ROWS.values()}
    assert {*rows["variant"]} == {"truth"}
    for question, model in ROWS.items():
        count = sum(one[0] == question for one in asked.cases)
        for row in rows[(rows["model"] == model) & (rows["garment"] == ALL)].itertuples():
            assert row.n == count
            if row.metric.startswith("openings_right"):
                assert row.value == 1
            else:
                # An OBJ has six digits.
                assert 0 <= row.value < {"mm": 1e-3, "deg": 0.1}[row.unit]


def assert_same_rows(found, expected):
    """But for the rounding of files; at an edge it decides whose normal counts."""
    keys = ["model", "variant", "split", "garment", "metric", "seed", "source"]
    found, expected = (table.set_index(keys).sort_index() for table in (found, expected))
    assert found.index.equals(expected.index)
    assert found[["unit", "n"]].equals(expected[["unit", "n"]])
    angles = found["unit"] == "deg"
    assert 0 < angles.sum() < len(found)
    for rows, atol in ((angles, 0.5), (~angles, 2e-3)):
        np.testing.assert_allclose(found["value"][rows], expected["value"][rows], atol=atol)


@pytest.fixture
def about():
    return {"split": TOLD["split"], "seed": TOLD["seed"]}


def skinned(rest, wearer, body):
    """A garment as skinning carries it to the last pose that is told, in the wearer's world."""
    pose = np.atleast_2d(wearer["poses"])[-1:]
    (posed,) = repose(rest, body, wearer["shape"], pose)
    return Mesh((posed + np.atleast_2d(wearer["trans"])[-1]).astype(np.float32), rest.faces)


def test_motion_that_is_answered_is_scored_as_that_of_our_own_movers(asked, about, tmp_path):
    """The one reads the protocol, the other is a mover."""

    def from_files(question, case, garment):
        rest = load_obj(asked.folder / question / case / f"{garment}.obj")
        with np.load(asked.folder / question / case / "wearer.npz") as wearer:
            return skinned(rest, wearer, asked.body)

    def move(known):
        person = known.person
        here = {"poses": person.poses, "shape": person.shape, "trans": np.zeros(3)}
        moved = {name: skinned(rest, here, asked.body) for name, rest in person.rest.items()}
        return {"skin": moved}

    answers = answer(tmp_path / "skin", asked, from_files, ["motion"])
    told = {"garments": TOLD["garments"], **about}
    expected, _, _ = compare_frames(asked.scans("clean"), move, Stopwatch(), model=MOVED, **told)
    assert_same_rows(asked.score(answers), expected)
    assert find_value(expected, "skin", "test", ALL, "surface_to_true_mm").value > 1


@pytest.mark.parametrize(("question", "kind"), [("points", "clean"), ("worse_points", "worse")])
def test_garments_found_in_points_are_scored_as_those_of_our_own_fitters(
    asked, about, tmp_path, question, kind
):
    """The one reads the window of the protocol, the other is given the body as fitted."""
    rest = {name: asked.true("picture", f"{SAMPLES[0]}_000", name) for name in ("Skirt", "Tshirt")}

    def from_files(question, case, garment):
        with np.load(asked.folder / question / case / "scan.npz") as scan:
            wearer = {name: scan[name] for name in ("poses", "shape", "trans")}
        middle = len(wearer["poses"]) // 2
        there = {name: wearer[name][middle] for name in ("poses", "trans")}
        return skinned(rest[garment], {**wearer, **there}, asked.body)

    def fit(known):
        state = known.body
        here = {"poses": state.pose, "shape": state.shape, "trans": state.trans}
        return {"skin": {name: skinned(mesh, here, asked.body) for name, mesh in rest.items()}}

    answers = answer(tmp_path / "skin", asked, from_files, [question])
    told = {"model": SCANNED[kind], "garments": TOLD["garments"], **about}
    expected, _, _ = compare_frames(asked.scans(kind), fit, Stopwatch(), **told)
    assert_same_rows(asked.score(answers), expected)
    assert find_value(expected, "skin", "test", ALL, "surface_to_true_mm").value > 1


def wider(mesh):
    return Mesh(mesh.vertices * np.float32([1.1, 1.1, 1]), mesh.faces)


class Wider:
    variant = "wide"

    def rebuild(self, garments):
        return (wider(one.mesh) for one in garments)

    def code_numbers(self, garment):
        return None


def test_garments_at_rest_are_scored_as_our_own_are(asked, about, tmp_path):
    answers = answer(
        tmp_path / "wide", asked, lambda *case: wider(asked.true(*case)), ["rest", "picture"]
    )
    held = held_out_garments(
        StaticData(asked.given["data"]),
        load_static(asked.given["outfits"][0]),
        TOLD["garments"],
        TOLD["split"],
    )
    codes, _ = compare_representations(held, [Wider()], **about)
    job = job_of(asked.given, tmp_path, **TOLD)
    known = pictures_of_job(job, toy_bodies(asked.body), [*GARMENT_CLASSES])
    measured = [
        Measured(one.clip, one.garments[kind], rest_distances(wider(true), true), one.source)
        for one in known
        for kind, true in one.rest.items()
        if kind in one.person.garments
    ]
    pictured = summarise(measured, model="picture", variant="wide", **about)
    assert_same_rows(asked.score(answers), join([codes, pictured]))


def test_a_method_may_leave_out_questions_and_types(asked, truth, tmp_path):
    answers = tmp_path / "some"
    for path in truth.glob("motion/*/Skirt.obj"):
        target = answers / path.relative_to(truth)
        target.parent.mkdir(parents=True)
        shutil.copyfile(path, target)
    rows = asked.score(answers)
    assert {*rows["model"]} == {"moved"}
    count = sum(one[::2] == ("motion", "Skirt") for one in asked.cases)
    assert {*rows.loc[rows["garment"] == ALL, "n"]} == {count}


def test_quads_are_scored_as_their_triangles(asked, truth, tmp_path):
    quads = shutil.copytree(truth, tmp_path / "truth")
    for question, case, garment in asked.cases:
        if question == "picture":
            with Sample(asked.given["samples"][0] / case.split("_")[0]) as sample:
                mesh = sample.mesh(garment)
            assert mesh.faces.shape[1] == 4
            save_obj(quads / question / case / f"{garment}.obj", Mesh(mesh.vertices, mesh.faces))
    assert_same_rows(asked.score(quads), asked.score(truth))


# ---- what is refused --------------------------------------------------------------------------


@pytest.fixture
def answers(truth, tmp_path):
    """A copy that may be damaged."""
    return shutil.copytree(truth, tmp_path / "mine")


def refused(asked, answers, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        asked.score(answers)
    assert "\n" not in str(caught.value)
    assert not list(answers.parent.glob("* scored"))


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_missing_answer_is_named(asked, answers, question):
    case = next(one for one in asked.cases if one[0] == question)
    path = answers / Path(*case).with_suffix(".obj")
    path.unlink()
    sentence = f"{path}: no such file, expected an answer for every {case[2]} since there are some"
    refused(asked, answers, sentence)


@pytest.mark.parametrize("place", ["motion/00009_001/Skirt.obj", "motion/00001_001/Dress.obj"])
def test_an_answer_that_nobody_asked_for_is_named(asked, answers, place):
    path = answers / place
    path.parent.mkdir(exist_ok=True)
    shutil.copyfile(answers / "motion/00001_001/Skirt.obj", path)
    refused(asked, answers, f"{path}: answers no case of 'motion', expected one of cases.tsv's")


@pytest.mark.parametrize(
    "place",
    [
        *("motions/00001_001/Skirt.obj", "motion/00001_001/Skirt.ply", "motion/Skirt.obj"),
        *("motion/00001_001/final/Skirt.obj", "Skirt.obj", "motion/00001_001/Skirt.OBJ"),
    ],
)
def test_a_file_that_is_no_answer_is_named(asked, answers, place):
    path = answers / place
    path.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(answers / "motion/00001_001/Tshirt.obj", path)
    refused(asked, answers, f"{path}: is no answer, expected .question./.case./.garment..obj")


def test_a_folder_without_answers_is_refused(asked, tmp_path):
    (tmp_path / "mine").mkdir()
    for name in ("mine", "nothing"):
        sentence = f"{name}: has no answer, expected meshes such as motion/CASE/Skirt.obj"
        refused(asked, tmp_path / name, sentence)


@pytest.mark.parametrize(
    "name", ["svae", "static_ppca_18", "moved_nearest", "smplicit_scan_code", "picture_nearest"]
)
def test_a_method_that_is_called_like_one_of_ours_is_refused(asked, answers, name):
    answers = answers.rename(answers.with_name(name))
    sentence = f"{name}: '{name}' is the name of a method of ours, expected another one"
    refused(asked, answers, sentence)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("v 0 0 0\n", "1 vertices and 0 faces"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "a face names vertex 9, expected 1 to 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 nan\nf 1 2 3\n", "vertex 3 is not finite"),
        ("", "0 vertices and 0 faces"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\nf 1 1 2\n", "without area, expected a surface"),
    ],
)
@pytest.mark.parametrize("question", QUESTIONS)
def test_a_broken_answer_is_named(asked, answers, question, text, reason):
    case = next(one for one in asked.cases if one[0] == question)
    path = answers / Path(*case).with_suffix(".obj")
    path.write_text(text)
    refused(asked, answers, f"{path}: .*({reason})")


def test_readers_are_told_what_there_is(asked):
    """The page beside the cases names each question, and arrays that they come with."""
    text = (asked.folder / "README.md").read_text()
    for question in QUESTIONS:
        assert f"| `{question}` |" in text
    rest_pose = np.load(asked.folder / "bodies/rest_pose.npz")["rest_pose"]
    for gender in toy_bodies(asked.body):
        body = drapeline.load_body(asked.folder / f"bodies/{gender}.npz")
        assert drapeline.posed_vertices(body, np.zeros(10), rest_pose[None])[0].shape[0] == 1
