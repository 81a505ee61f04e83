"""Trained stages from their folders."""

import pytest
import torch

from drapeline.errors import DamagedFile, InputError
from drapeline.models.garment4d.stages import CanonicalStage, MgnStage, PosedStage, load_stage
from drapeline.models.training.checkpoints import read_checkpoint, write_checkpoint
from drapeline.models.training.module import BEST
from toys.garment4d_stages import batch_of
from toys.histories import column


def test_a_loaded_stage_says_what_was_validated_last(trained_posed, trained_canonical, sequences):
    stage = load_stage(trained_posed, PosedStage)
    assert not stage.training
    alone = load_stage(trained_canonical, CanonicalStage)
    for key, value in alone.state_dict().items():
        torch.testing.assert_close(value, stage.canonical.state_dict()[key], msg=key)
    # The history's validation errors are those of the weights that were kept.
    batch = batch_of(alone, sequences, "val")
    with torch.inference_mode():
        terms, _ = alone.losses(batch)
    assert float(terms["total"]) == pytest.approx(
        min(column(trained_canonical, "val_total")), rel=0.02
    )


def test_networks_of_other_types_and_missing_ones_are_refused(trained_canonical, tmp_path):
    with pytest.raises(InputError, match="holds a 'garment4d_canonical' network, expected"):
        load_stage(trained_canonical, PosedStage, MgnStage)
    with pytest.raises(InputError, match="no such file"):
        load_stage(tmp_path, PosedStage)


def test_a_template_whose_faces_name_vertices_that_are_not_there_is_refused(
    trained_canonical, tmp_path
):
    saved = read_checkpoint(trained_canonical / BEST)
    saved.metadata["space"]["faces"][0, 0] = 100_000
    write_checkpoint(tmp_path / BEST, *saved)
    with pytest.raises(DamagedFile, match=rf"{BEST}: .*'faces' names number 100000"):
        load_stage(tmp_path, CanonicalStage)
