from drapeline.outfits.settings import OwnGarment, own_garments


def test_a_path_is_for_both_genders():
    assert own_garments({"Skirt": "skirt.obj"}) == {
        gender: {"Skirt": {"path": "skirt.obj"}} for gender in ("female", "male")
    }


def test_a_gender_has_its_own_file_or_that_of_both_or_none():
    worn = {"fabric": "silk", "elastic": ["bottom"], "held": None}
    found = own_garments(
        {
            "Skirt": {"female": "f.obj", **worn},
            "Dress": {"file": "both.obj", "male": "m.obj", **worn},
        }
    )
    assert found["female"] == {
        "Skirt": {"path": "f.obj", **worn},
        "Dress": {"path": "both.obj", **worn},
    }
    assert found["male"] == {"Dress": {"path": "m.obj", **worn}}
    assert OwnGarment(**found["male"]["Dress"]).fabric == "silk"
