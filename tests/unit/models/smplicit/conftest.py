import pytest

from smplicit_toys import toy_fields
from toys import toy_body as make_toy_body


@pytest.fixture(scope="session")
def fields(tmp_path_factory):
    """Fields of the toy skirts."""
    return toy_fields(tmp_path_factory.mktemp("fields"), make_toy_body)
