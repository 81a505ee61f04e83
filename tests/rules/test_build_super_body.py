"""The rule `build_super_body`: refined bodies that load as bodies, and their topologies."""

import numpy as np
import pytest

from drapeline.bodies.model import load_body, save_body
from drapeline.registration.to_body.topology import load_topology


@pytest.fixture
def files(tmp_path, toy_body):
    inputs = {gender: tmp_path / f"{gender}.npz" for gender in ("female", "male")}
    for path in inputs.values():
        save_body(path, toy_body)
    out = tmp_path / "registration"
    outputs = {gender: out / "body" / f"{gender}.npz" for gender in inputs}
    return inputs, {**outputs, "topology": out / "topology.npz"}


def test_super_body_writes_both_genders_and_the_topology(run_rule, files):
    inputs, outputs = files
    run_rule("build_super_body", input=inputs, output=outputs, params={"vertices": 2000})
    topology = load_topology(outputs["topology"])
    for gender in inputs:
        body = load_body(outputs[gender])
        assert body.v_template.shape == (2000, 3)
        assert body.name == "toy-1-super-2000"
        np.testing.assert_array_equal(body.faces, topology.faces)
    assert topology.segments.max() == 20


def test_too_few_vertices_end_the_job_in_one_sentence(run_rule, files):
    inputs, outputs = files
    with pytest.raises(SystemExit, match="at most the 300 asked for"):
        run_rule("build_super_body", input=inputs, output=outputs, params={"vertices": 300})
    assert not outputs["topology"].exists()
