import pytest

from toys.tiny_sample import TinySample, write_tiny_sample


@pytest.fixture(scope="session")
def tiny(tmp_path_factory, toy_body) -> TinySample:
    """One accepted sample; not to be changed."""
    return write_tiny_sample(tmp_path_factory.mktemp("stages"), toy_body)
