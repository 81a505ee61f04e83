from drapeline.models.training.settings import override_settings


def test_changes_replace_single_settings_and_leave_their_source_alone():
    settings = {"loss": {"normals": 70.0, "mask": 0.1}, "training": {"epochs": 2}}
    changed = override_settings(settings, {"loss": {"mask": 1.0}, "skinning": {"passes": 0}})
    assert changed == {"loss": {"normals": 70.0, "mask": 1.0}, "training": {"epochs": 2}}
    assert settings["loss"]["mask"] == 0.1
