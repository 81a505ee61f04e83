"""A round skirt as a template."""

import pytest

from toys.templates import as_template, round_skirt


@pytest.fixture(scope="module")
def template():
    return as_template(*round_skirt(around=24, rows=11))
