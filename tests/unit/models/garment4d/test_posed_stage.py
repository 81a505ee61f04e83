"""The posed stage in training."""

import numpy as np
import pytest
import torch

from drapeline.models.garment4d.canonical_stage import CanonicalStage
from drapeline.models.garment4d.data import window_starts
from drapeline.models.garment4d.load import load_stage
from drapeline.models.garment4d.posed_stage import PosedStage
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.checkpoints import read_checkpoint
from garment4d_stages import batch_of, column
from garment4d_toys import POSED


def test_the_posed_stage_learns_the_sway_that_skinning_lacks(trained_posed, data):
    stage = load_stage(trained_posed, PosedStage)
    data.wear(stage.predicted_canonicals(data, ("val",)), stage.settings.skinning)
    batch = batch_of(data, stage, "val")
    assert set(data.source[batch["sequence"]]) == {"simulated", "skinned"}
    errors = column(trained_posed, "val_vertex_error_mm")
    assert min(errors) < 0.8 * errors[0]
    proposal = 1000 * (batch["proposal"] - batch["target"]).norm(dim=-1).mean()
    assert min(errors) < 0.9 * float(proposal)


def test_the_canonical_network_is_not_trained_further(trained_posed, trained_canonical):
    before = read_checkpoint(trained_canonical / "best.ckpt")["state_dict"]
    after = read_checkpoint(trained_posed / "last.ckpt")["state_dict"]
    for key, value in before.items():
        torch.testing.assert_close(after[f"canonical.{key}"], value, msg=key)


def test_levels_from_memory_are_those_of_the_network(trained_posed, data, monkeypatch):
    stage = load_stage(trained_posed, PosedStage)
    batch = batch_of(data, stage, "val")
    count = len(batch["names"])
    part = {key: value[: count - 1] for key, value in batch.items()}
    stage.kept_levels(part)
    expected = stage.levels(batch["points"]).levels
    asked = []
    levels = stage.levels
    monkeypatch.setattr(stage, "levels", lambda points: asked.append(len(points)) or levels(points))
    for _ in range(2):
        for one, true in zip(stage.kept_levels(batch), expected, strict=True):
            for x, y in zip(one, true, strict=True):
                torch.testing.assert_close(x, y)
    assert asked == [1]
    # Without room for more everything is asked for anew.
    stage._kept.clear()
    stage._room = 0
    stage.kept_levels(batch)
    stage.kept_levels(batch)
    assert asked == [1, count, count]


def test_windows_that_canonical_garments_were_predicted_from_are_not_asked_for_again(
    data, trained_posed, monkeypatch
):
    stage = load_stage(trained_posed, PosedStage)
    found = stage.predicted_canonicals(data, ("val",))
    validated = data.of_split("val")
    np.testing.assert_array_equal(found[data.split == "test"], data.space.mean[None])
    batch = as_tensors(data.batch(data.windows("val", 3, 3), 3, posed=False))
    with torch.no_grad():
        for sequence in validated:
            part = {k: v[batch["sequence"] == sequence] for k, v in batch.items() if k == "points"}
            alpha = stage.levels(part["points"]).coefficients.mean(0).numpy()
            np.testing.assert_allclose(found[sequence], data.space.vertices(alpha), atol=1e-5)
    expected = stage.levels(batch["points"]).levels
    monkeypatch.setattr(stage, "levels", None)
    for one, true in zip(stage.kept_levels(batch), expected, strict=True):
        for x, y in zip(one, true, strict=True):
            torch.testing.assert_close(x, y)


def test_proposals_of_training_garments_begin_with_what_is_left_out(trained_body_relative, data):
    stage = PosedStage(
        PosedStage.settings_of(POSED), load_stage(trained_body_relative, CanonicalStage)
    )
    found = stage.predicted_canonicals(data, ("train", "val"))
    for split in ("train", "val"):
        sequence = int(data.of_split(split)[0])
        name = str(data.name[sequence])
        points = torch.from_numpy(data.clouds(sequence, body_relative_points=True))
        starts = window_starts(len(points), 3, 3, name)
        windows = torch.stack([points[start : start + 3] for start in starts])
        initial_alpha = None
        if split == "train":
            initial_alpha = stage.canonical.out_of_fold_alpha[name].expand(len(windows), -1)
        with torch.no_grad():
            alpha = (
                stage.canonical.network(windows, None, initial_alpha).coefficients.mean(0).numpy()
            )
        np.testing.assert_allclose(found[sequence], data.space.vertices(alpha), atol=1e-4)


def test_the_released_loss_of_the_posed_stage_sees_the_garment_alone(data, trained_canonical):
    stage = load_stage(trained_canonical, CanonicalStage)
    values = {**POSED, "loss": {"laplacian_form": "released"}}
    posed = PosedStage(PosedStage.settings_of(values), stage)
    batch = as_tensors(data.batch(data.windows("val", 3, 3), 3, posed=True))
    with torch.no_grad():
        terms, _ = posed.losses(batch)
        others, _ = posed.losses({**batch, "target": 2 * batch["target"]})
    torch.testing.assert_close(terms["laplacian"], others["laplacian"])
    assert float(terms["laplacian"]) > 0
    assert float(terms["vertices"]) != pytest.approx(float(others["vertices"]))
