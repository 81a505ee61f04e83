from drapeline.models.smplicit.settings import FieldSettings


def test_settings_come_back_from_plain_values():
    settings = FieldSettings(
        network={"cut": 4}, loss={"d_max_m": 0.01}, training={"optimizer": "adam"}
    )
    assert settings.network.cut == 4
    assert settings.loss.d_max_m == 0.01
    assert FieldSettings(**settings.plain()) == settings
