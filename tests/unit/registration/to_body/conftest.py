"""A refined toy body and its topology."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import (
    build_topology,
)


@pytest.fixture(scope="session", params=["symmetric", "rough"])
def made(request, toy_body):
    """A refined body and its topology."""
    body = toy_body
    if request.param == "rough":
        noise = np.random.default_rng(0).normal(0, 5e-4, body.v_template.shape)
        body = replace(body, v_template=(body.v_template + noise).astype("f4"))
    refined = build_super_body({"female": body, "male": body}, 3000)
    return refined, build_topology(refined)
