"""Pictures that are recorded rather than rendered."""

import numpy as np
import pytest

from drapeline.report.models import scene


@pytest.fixture
def made(monkeypatch):
    """Parts of every picture, in place of rendering them."""
    found = []

    def record(parts, camera, **_):
        found.append(parts)
        return np.full((camera.height, camera.width, 3), 200, dtype=np.uint8)

    monkeypatch.setattr(scene, "raytrace", record)
    return found
