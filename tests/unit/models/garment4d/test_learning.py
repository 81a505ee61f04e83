"""What training the stages of Garment4D comes to on any processor."""

import numpy as np
import pytest
import torch

from drapeline.models.garment4d.data import DressedSequences
from drapeline.models.garment4d.ours.labels import LabelledClouds, LabelStage
from drapeline.models.garment4d.stages import CanonicalStage, MgnStage, PointNetStage, PosedStage
from drapeline.models.training.batches import as_tensors
from toys.garment4d import CANONICAL, LABELLING, POSED
from toys.garment4d_stages import build_canonical, stage_windows
from toys.learning import (
    assert_a_step_lowers,
    assert_learned_by_heart,
    assert_mixed_precision_agrees,
    assert_true_gradients,
    doubles,
    shake_weights,
)

CANONICAL_STAGES = {
    "canonical": (CanonicalStage, CANONICAL),
    "pointnet": (PointNetStage, CANONICAL),
}
POSED_STAGES = {
    "posed": (PosedStage, POSED),
    "mgn": (MgnStage, {**POSED, "network": {"widths": [32, 32, 64]}}),
}
STAGES = {**CANONICAL_STAGES, **POSED_STAGES, "labels": (LabelStage, LABELLING)}


def build(name, sequences, clouds, astray=0.0, **training):
    """A stage with the windows it is trained on.

    The posed ones dress bodies in garments that are so far `astray` (metres): what they have to
    make up for is then mostly the same everywhere, and no network is too small to learn it.
    """
    cls, values = STAGES[name]
    values = {**values, "training": {**values["training"], **training}}
    if name == "labels":
        stage = cls(cls.SETTINGS(**values))
        windows = LabelledClouds(
            clouds, frames=3, stride=3, sources=stage.settings.training.sources
        )
        stage.prepare(windows)
        return stage, windows
    if name in CANONICAL_STAGES:
        stage = build_canonical(sequences, values, cls)
        windows = stage_windows(stage, sequences)
        stage.prepare(windows)
        return stage, windows
    canonical = build_canonical(sequences, CANONICAL).eval()
    with torch.no_grad():  # an untrained one may see no garment, and so show the posed ones nothing
        canonical.network.segmentation.head[-1].bias[canonical.label] += 1e3
    stage = cls(cls.SETTINGS(**values), canonical)
    worn = sequences.data.canonical + np.float32([0, astray, 0])
    dressed = DressedSequences(sequences, worn, stage.settings.skinning)
    return stage, stage_windows(stage, dressed)


def batch_of(windows, count):
    """So many training windows, spread over the sequences."""
    rows = windows.rows("train")
    return as_tensors(windows.batch(rows[:: len(rows) // count][:count]))


@pytest.mark.parametrize("name", STAGES)
def test_gradients_of_the_whole_loss_by_finite_differences(sequences, clouds, name):
    stage, windows = build(name, sequences, clouds)
    stage, batch = shake_weights(stage, 0.02).train().double(), doubles(batch_of(windows, 2))
    assert_true_gradients(stage, lambda stage: stage.training_step(batch))
    assert_a_step_lowers(stage, lambda stage: stage.training_step(batch))


@pytest.mark.parametrize("name", STAGES)
def test_mixed_precision_gives_almost_the_same_loss_and_gradient(sequences, clouds, name):
    stage, windows = build(name, sequences, clouds)
    batch = batch_of(windows, 2)
    # Points that are almost as far as others take turns in the other networks' many maxima.
    cosine = 0.9 if name in POSED_STAGES else 0.0
    assert_mixed_precision_agrees(
        shake_weights(stage, 0.02).train(),
        lambda stage: stage.training_step(batch),
        cosine=cosine,
    )


@pytest.mark.parametrize(
    ("name", "windows", "rate"),
    [
        ("canonical", 4, 0.005),
        ("pointnet", 4, 0.005),
        ("labels", 4, 0.005),
        ("posed", 1, 0.01),
        ("mgn", 1, 0.1),
    ],
)
def test_one_batch_is_learned_by_heart(sequences, clouds, name, windows, rate):
    stage, drawn = build(name, sequences, clouds, astray=0.3, learning_rate=rate)
    assert_learned_by_heart(stage.train(), batch_of(drawn, windows), stage.ERROR, steps=500)
