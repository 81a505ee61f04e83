"""Frames of registered samples, collected into arrays."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body, signed_tightness
from drapeline.dataset.reader import Sample
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.learning_data.dynamic import DynamicData, collect_dynamic
from drapeline.learning_data.static import static_cvar
from drapeline.outfits.garment_types import GARMENTS, SKIRTS
from drapeline.registration.to_body.dynamic_offsets import load_sample_garment, points_from_offsets
from toys.moving import write_registered_sample

FRAMES, STEP = 6, 2


@pytest.fixture(scope="module")
def stages(tmp_path_factory):
    return tmp_path_factory.mktemp("stages")


@pytest.fixture(scope="module")
def samples(stages, toy_body):
    """Two accepted samples of different splits, and a rejected one."""
    given = (("00001", "train", "accepted"), ("00002", "test", "rejected"))
    given += (("00003", "test", "accepted"),)
    return [write_registered_sample(stages, toy_body, *each) for each in given]


def collect(folder, samples, body, version):
    pairs = {s.tiny.folder: s.registration for s in samples}
    bodies = dict.fromkeys(GENDERS, body)
    count = collect_dynamic(folder, pairs, bodies, version=version, step=STEP)
    return count, DynamicData(folder)


@pytest.fixture(scope="module", params=["posed", "unposed"])
def collected(request, stages, samples, toy_body):
    return collect(stages / "dynamic" / request.param, samples, toy_body, request.param)


def test_rows_are_every_few_frames_of_the_accepted_samples_garments(collected):
    count, data = collected
    assert count == len(data) == 2 * 2 * FRAMES // STEP
    assert set(data.sample) == {"00001", "00003"}
    for sample, split in (("00001", "train"), ("00003", "test")):
        rows = [data.rows_of(sample, garment) for garment in ("Tshirt", "Skirt")]
        for own in rows:
            np.testing.assert_array_equal(data.frame[own], np.arange(0, FRAMES, STEP))
        np.testing.assert_array_equal(np.sort(np.concatenate(rows)), data.rows(split))
    skirts = data.rows_of("00001", "Skirt")
    assert "Skirt" in SKIRTS
    assert (data.topology(skirts) == 1).all()
    assert (data.topology(data.rows_of("00001", "Tshirt")) == 0).all()


def test_poses_are_those_of_the_frame_and_of_every_third_before_it(collected, samples):
    _, data = collected
    poses = samples[0].tiny.poses
    for row in data.rows_of("00001", "Tshirt"):
        frame = data.frame[row]
        # Before the first frame the body stands still.
        expected = poses[np.maximum([frame, frame - 3, frame - 6, frame - 9], 0)]
        np.testing.assert_allclose(data.poses[row], expected, atol=1e-6)


def test_offsets_lead_back_to_the_cloth(collected, samples, toy_body):
    _, data = collected
    for sample in (samples[0], samples[2]):
        tiny = sample.tiny
        for name in tiny.meshes:
            rows = data.rows_of(tiny.folder.name, name)
            registered = load_sample_garment(sample.registration / f"{name}.npz")
            points = points_from_offsets(
                registered,
                data.offsets[rows],
                toy_body,
                tiny.shape,
                data.poses[rows, 0],
                data.version,
            )
            truth = registered.points(tiny.vertices[name][data.frame[rows]])
            np.testing.assert_allclose(points, truth, atol=1e-4)
            mask = data.mask[data.garment_index[rows]]
            assert not data.offsets[rows][~mask].any()


def test_posed_offsets_start_from_the_body_and_unposed_ones_from_the_garment_at_rest(
    collected, samples, toy_body
):
    _, data = collected
    rows = data.rows_of("00001", "Tshirt")
    rest = rest_body(toy_body, samples[0].tiny.shape)
    static = data.static[data.garment_index[rows[0]]]
    if data.version == "unposed":
        np.testing.assert_allclose(
            data.base[rows], np.tile(rest + static, (len(rows), 1, 1)), atol=1e-6
        )
    else:
        assert np.abs(data.base[rows[0]] - data.base[rows[-1]]).max() > 0.01


def test_garments_at_rest_are_what_a_static_network_takes(collected, samples):
    _, data = collected
    garments = np.arange(len(data.garment))
    batch = data.static_batch(garments)
    np.testing.assert_array_equal(batch["offsets"], data.static)
    np.testing.assert_array_equal(batch["mask"], data.mask)
    first = samples[0].tiny
    expected = static_cvar(
        first.shape[None], np.array([0]), signed_tightness(np.array([-1.0, 0.25]), "female")[None]
    )
    np.testing.assert_allclose(batch["cvar"][0], expected[0], atol=1e-6)
    assert batch["names"] == [
        f"{sample}/{GARMENTS[garment]}"
        for sample, garment in zip(data.sample, data.garment, strict=True)
    ]


def test_without_accepted_samples_there_is_one_sentence(stages, samples, toy_body):
    with pytest.raises(InputError, match="none of 1 samples was accepted"):
        collect(stages / "none", samples[1:2], toy_body, "posed")
    assert not (stages / "none").exists()


def test_a_sample_without_tightness_is_refused(tmp_path, samples, toy_body, monkeypatch):
    folder = samples[0].tiny.folder
    monkeypatch.setattr(Sample, "info", replace(Sample(folder).info, tightness=None))
    with pytest.raises(InputError, match=rf"{folder}: info.mat has no tightness, expected two"):
        collect(tmp_path / "dynamic", samples[:1], toy_body, "posed")
