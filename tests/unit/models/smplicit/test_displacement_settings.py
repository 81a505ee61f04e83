from dataclasses import asdict

from drapeline.models.smplicit.displacement_settings import DisplacementSettings


def test_settings_come_back_from_plain_values():
    settings = DisplacementSettings.of(
        {"network": {"code": 4}, "loss": {"edge": 2.0}, "training": {"edges": 7}}
    )
    assert settings.network.code == 4
    assert settings.loss.edge == 2.0
    assert settings.training.edges == 7
    assert DisplacementSettings.of(asdict(settings)) == settings
