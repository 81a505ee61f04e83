import inspect

import pytest

from drapeline.models.smplicit.surface.fields import DistanceField, NearBody, NetworkField


@pytest.mark.parametrize("cls", [NearBody, NetworkField])
def test_fields_are_what_the_extraction_of_surfaces_takes(cls):
    for name in ("distances", "gradients"):
        expected, found = (inspect.signature(getattr(one, name)) for one in (DistanceField, cls))
        assert found.parameters.keys() == expected.parameters.keys()
