import inspect

import pytest

from drapeline.models.smplicit.fields import Field
from drapeline.models.smplicit.model import NearBody
from drapeline.models.smplicit.network_field import NetworkField


@pytest.mark.parametrize("cls", [NearBody, NetworkField])
def test_fields_are_what_the_extraction_of_surfaces_takes(cls):
    for name in ("distances", "gradients"):
        expected, found = (inspect.signature(getattr(one, name)) for one in (Field, cls))
        assert found.parameters.keys() == expected.parameters.keys()
