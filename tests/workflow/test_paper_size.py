"""workflow/config/paper.yaml takes what the papers print: the defaults of the library's classes."""

from dataclasses import asdict
from functools import reduce
from pathlib import Path

import pytest
import yaml

from drapeline.experiment.config import fill_settings
from drapeline.models.garment4d.canonical import CanonicalWeights
from drapeline.models.garment4d.posed import MgnSettings, PosedSettings, PosedWeights
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.gcvae.loss import GcvaeLoss
from drapeline.models.gcvae.networks import GcvaeNetwork
from drapeline.models.training.module import Training
from drapeline.simulation.attempts import SimulationSettings

ROOT = Path(__file__).parents[2]
SCHEMA = yaml.safe_load((ROOT / "workflow/schemas/config.schema.yaml").read_text())
PAPER = ROOT / "workflow/config/paper.yaml"
PRINTED = {
    "simulation.settings": SimulationSettings(),
    "gcvae.loss": GcvaeLoss(),
    "gcvae.svae.network": GcvaeNetwork(),
    "gcvae.dvae.network": GcvaeNetwork(),
    "gcvae.svae.training": Training(),
    "gcvae.dvae.training": Training(),
    "garment4d.skinning": SkinningSettings(),
    "garment4d.canonical.loss": CanonicalWeights(),
    "garment4d.posed.loss": PosedWeights(),
    "garment4d.posed.network": PosedSettings(),
    "garment4d.mgn.network": MgnSettings(),
}


@pytest.fixture(scope="module")
def paper():
    return fill_settings(yaml.safe_load(PAPER.read_text()), SCHEMA, PAPER.name)


@pytest.mark.parametrize("path", PRINTED)
def test_printed_values_are_taken(paper, path):
    printed = _lists(asdict(PRINTED[path]))
    taken = reduce(lambda part, key: part[key], path.split("."), paper)
    common = taken.keys() & printed.keys()
    assert len(common) >= 2
    assert {key: taken[key] for key in common} == {key: printed[key] for key in common}


def test_printed_values_that_no_class_holds_are_taken(paper):
    assert paper["gcvae"]["dvae"]["static_model"] == "svae"
    assert paper["gcvae"]["sampling"]["settle"] is False
    assert paper["garment4d"]["canonical"]["network"]["width"] == 1
    assert paper["garment4d"]["canonical"]["network"]["body_relative_points"] is False
    assert paper["garment4d"]["clouds"]["points"] == 6890
    assert paper["static"]["count"] == 30_000


def test_garments_are_fitted_and_moved_as_in_smplicits_paper(paper):
    smplicit = paper["smplicit"]
    moved = {key: smplicit["gallery"][key] for key in ("simulate", "skinning", "push_out")}
    assert moved == {"simulate": False, "skinning": "nearest", "push_out": False}
    pictured = smplicit["fit_images"]
    assert (pictured["neighbours"], pictured["smoothing"], pictured["hang_frames"]) == (1, 0, 0)
    assert pictured["clearance"] is False
    scanned = smplicit["fit_scans"]
    assert (scanned["neighbours"], scanned["uncovered_weight"], scanned["hang_frames"]) == (1, 1, 0)


def _lists(values):
    return {key: list(v) if isinstance(v, tuple) else v for key, v in values.items()}
