"""The posed stage in training."""

import numpy as np
import pytest
import torch

from drapeline.dataset.windows import window_starts
from drapeline.models.garment4d.canonical_stage import CanonicalStage
from drapeline.models.garment4d.dressed import DressedSequences
from drapeline.models.garment4d.load import load_stage
from drapeline.models.garment4d.posed_stage import PosedStage
from drapeline.models.layers.pointnet import PointLevel
from drapeline.models.training.batches import ByteCache, as_tensors
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST
from toys.garment4d import POSED
from toys.garment4d_stages import batch_of
from toys.histories import column


def test_the_error_that_is_logged_is_that_of_the_posed_garments(trained_posed, sequences):
    stage = load_stage(trained_posed, PosedStage)
    batch = batch_of(stage, stage.dress(sequences, ("val",)), "val")
    assert set(sequences.data.source[batch["sequence"]]) == {"blender", "skinned"}
    with torch.no_grad():
        made = stage.predict(batch, stage.point_levels(batch))[-1]
    expected = 1000 * (made - batch["target"]).norm(dim=-1).mean()
    best = np.argmin(column(trained_posed, "val_total"))
    assert column(trained_posed, "val_vertex_error_mm")[best] == pytest.approx(
        float(expected), rel=1e-3
    )


def test_the_canonical_network_is_not_trained_further(trained_posed, trained_canonical):
    before = read_checkpoint(trained_canonical / BEST).weights
    after = read_checkpoint(trained_posed / BEST).weights
    for key, value in before.items():
        torch.testing.assert_close(after[f"canonical.{key}"], value, msg=key)


def test_sequences_are_dressed_in_what_the_canonical_network_predicts(trained_posed, sequences):
    stage = load_stage(trained_posed, PosedStage)
    dressed = stage.training_sequences(sequences)
    expected = stage.predict_canonicals(sequences.data, ("train", "val"))
    np.testing.assert_array_equal(dressed.canonical, expected)
    assert dressed.skinning == stage.settings.skinning
    window = np.array([[4, 1]])
    np.testing.assert_array_equal(dressed.batch(window, 3)["worn"], expected[4:5])


def test_point_levels_from_memory_are_those_of_the_network(trained_posed, sequences, monkeypatch):
    stage = load_stage(trained_posed, PosedStage)
    batch = batch_of(stage, sequences, "val")
    count = len(batch["names"])
    part = {key: value[: count - 1] for key, value in batch.items()}
    stage.point_levels(part)
    estimate = stage.estimate_canonical
    expected = estimate(batch["points"]).levels
    asked = []

    def counted(points):
        asked.append(len(points))
        return estimate(points)

    monkeypatch.setattr(stage, "estimate_canonical", counted)
    for _ in range(2):
        for one, true in zip(stage.point_levels(batch), expected, strict=True):
            for x, y in zip(one, true, strict=True):
                torch.testing.assert_close(x, y)
    assert asked == [1]
    # Without room everything is asked for anew.
    stage._levels = ByteCache(0)
    stage.point_levels(batch)
    stage.point_levels(batch)
    assert asked == [1, count, count]


def test_point_levels_from_memory_go_where_those_of_the_network_are(
    trained_posed, sequences, monkeypatch
):
    """Some were computed before the network was moved to where it is trained."""
    stage = load_stage(trained_posed, PosedStage)
    batch = batch_of(stage, sequences, "val")
    count = len(batch["names"])
    stage.point_levels({key: value[: count - 1] for key, value in batch.items()})
    estimate, cpu_points = stage.estimate_canonical, batch["points"]

    def elsewhere(points):
        found = estimate(cpu_points[-len(points) :])
        levels = [PointLevel(*(x.to("meta") for x in level)) for level in found.levels]
        return found._replace(levels=levels)

    monkeypatch.setattr(stage, "estimate_canonical", elsewhere)
    for level in stage.point_levels({**batch, "points": cpu_points.to("meta")}):
        assert {x.device.type for x in level} == {"meta"}


def test_windows_that_canonical_garments_were_predicted_from_are_not_asked_for_again(
    sequences, trained_posed, monkeypatch
):
    data, stage = sequences.data, load_stage(trained_posed, PosedStage)
    found = stage.predict_canonicals(data, ("val",))
    validated = data.of_split("val")
    np.testing.assert_array_equal(found[data.split == "test"], data.space.mean[None])
    batch = as_tensors(sequences.batch(data.windows("val", 3, 3), 3))
    for sequence in validated:
        points = batch["points"][batch["sequence"] == sequence]
        alpha = stage.estimate_canonical(points).coefficients.mean(0).numpy()
        np.testing.assert_allclose(found[sequence], data.space.vertices(alpha), atol=1e-5)
    expected = stage.estimate_canonical(batch["points"]).levels
    monkeypatch.setattr(stage, "estimate_canonical", None)
    for one, true in zip(stage.point_levels(batch), expected, strict=True):
        for x, y in zip(one, true, strict=True):
            torch.testing.assert_close(x, y)


def test_training_garments_are_predicted_from_their_out_of_fold_alpha(
    trained_body_relative, sequences
):
    data, canonical = sequences.data, load_stage(trained_body_relative, CanonicalStage)
    stage = PosedStage(PosedStage.SETTINGS(**POSED), canonical)
    found = stage.predict_canonicals(data, ("train", "val"))
    for split in ("train", "val"):
        sequence = int(data.of_split(split)[0])
        name = str(data.name[sequence])
        points = torch.from_numpy(data.clouds(sequence, body_relative_points=True))
        starts = window_starts(len(points), 3, 3, name)
        windows = torch.stack([points[start : start + 3] for start in starts])
        initial_alpha = None
        if split == "train":
            initial_alpha = canonical.out_of_fold_alpha[name].expand(len(windows), -1)
        with torch.no_grad():
            alpha = canonical.network(windows, None, initial_alpha).coefficients.mean(0).numpy()
        np.testing.assert_allclose(found[sequence], data.space.vertices(alpha), atol=1e-4)


def test_the_released_loss_of_the_posed_stage_sees_the_garment_alone(sequences, trained_canonical):
    values = {**POSED, "loss": {"laplacian_form": "released"}}
    posed = PosedStage(PosedStage.SETTINGS(**values), load_stage(trained_canonical, CanonicalStage))
    dressed = DressedSequences(sequences, sequences.data.canonical, posed.settings.skinning)
    batch = as_tensors(dressed.batch(sequences.data.windows("val", 3, 3), 3))
    with torch.no_grad():
        terms, _ = posed.losses(batch)
        others, _ = posed.losses({**batch, "target": 2 * batch["target"]})
    torch.testing.assert_close(terms["laplacian"], others["laplacian"])
    assert float(terms["laplacian"]) > 0
    assert float(others["vertices"]) > 1.1 * float(terms["vertices"])
