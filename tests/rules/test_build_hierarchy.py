"""The rules `build_hierarchy` and `plot_hierarchy`, on a toy body."""

import numpy as np
import pytest
from PIL import Image

from drapeline.registration.to_body.hierarchy import POOLINGS, load_hierarchy
from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import build_topology, save_topology


@pytest.fixture
def topology(tmp_path, toy_body):
    path = tmp_path / "topology.npz"
    save_topology(
        path, build_topology(build_super_body({"female": toy_body, "male": toy_body}, 1600))
    )
    return path


def test_hierarchies_are_built_and_drawn(run_rule, topology, tmp_path):
    paths = {pooling: tmp_path / f"hierarchy_{pooling}.npz" for pooling in POOLINGS}
    for pooling, path in paths.items():
        run_rule(
            "build_hierarchy",
            input={"topology": topology},
            output=[path],
            wildcards={"pooling": pooling},
        )
        assert load_hierarchy(path).counts[0] == 1600
        assert load_hierarchy(path).counts[-2:] == (56, 21)
    pictures = {name: tmp_path / "report" / f"{name}.png" for name in ("topologies", "hierarchy")}
    run_rule(
        "plot_hierarchy",
        input={"topology": topology, **paths},
        output=pictures,
        params={"rays": 0.02},
    )
    for path in pictures.values():
        with Image.open(path) as image:
            assert image.width > 1000
            # The colours of the figures are there, not only the backdrop.
            assert np.ptp(np.asarray(image.convert("RGB")), axis=2).max() > 60
