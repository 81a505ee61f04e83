from drapeline.models.smplicit.displacement_settings import DisplacementSettings


def test_settings_come_back_from_plain_values():
    settings = DisplacementSettings(network={"code": 4}, loss={"edge": 2.0}, training={"edges": 7})
    assert settings.network.code == 4
    assert settings.loss.edge == 2.0
    assert settings.training.edges == 7
    assert DisplacementSettings(**settings.plain()) == settings
