"""Files of an experiment, and which groups a model learns from."""

from drapeline.dataset.settings import SCAN_KINDS
from drapeline.experiment.settings import Scans
from toys.plans import files_of


def test_models_learn_from_all_groups_but_those_that_are_for_others():
    brief = {"count": 4, "solver": "xpbd", "prefix": "B", "learned_by": ["garment4d"]}
    files = files_of({"groups": {"dataset": {"count": 3}, "brief": brief}})
    own = {name: files.learned_by(name) for name in ("gcvae", "garment4d")}
    assert own["garment4d"].groups == files.groups
    assert own["gcvae"].groups.keys() == files.groups.keys() - {"brief"}
    left_out = {*files.moving_plans} - {*own["gcvae"].moving_plans}
    assert left_out == {f"B{number:05d}" for number in range(1, 5)}
    assert own["gcvae"].config == files.config


def test_the_same_samples_are_scanned_in_every_way():
    files = files_of({"groups": {"dataset": {"count": 12}}})
    found = [files.known_scans(kind) for kind in SCAN_KINDS]
    assert found[0]["samples"] == found[1]["samples"] == found[2]["samples"] != []
    every = [path for one in found for path in one["scans"]]
    assert len({*every}) == len(every) == len(SCAN_KINDS) * len(found[0]["scans"])
    assert {*SCAN_KINDS} <= Scans().plain().keys()
