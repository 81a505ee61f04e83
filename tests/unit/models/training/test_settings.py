import pytest

from drapeline.models.training.settings import (
    EpochTraining,
    StepTraining,
    override_settings,
)


def test_changes_replace_single_settings_and_leave_their_source_alone():
    settings = {"loss": {"normals": 70.0, "mask": 0.1}, "training": {"epochs": 2}}
    changed = override_settings(settings, {"loss": {"mask": 1.0}, "skinning": {"passes": 0}})
    assert changed == {"loss": {"normals": 70.0, "mask": 1.0}, "training": {"epochs": 2}}
    assert settings["loss"]["mask"] == 0.1


@pytest.mark.parametrize(
    ("steps", "batches", "epochs"), [(100, 10, 10), (104, 10, 10), (106, 10, 11), (3, 10, 1)]
)
def test_steps_are_whole_passes_at_least_one(steps, batches, epochs):
    rest = {"batch": 1, "learning_rate": 0.1, "schedule": "constant"}
    assert StepTraining(steps=steps, **rest).epochs_of(batches) == epochs
    assert EpochTraining(epochs=steps, **rest).epochs_of(batches) == steps
