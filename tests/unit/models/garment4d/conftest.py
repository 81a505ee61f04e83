"""Toy skirts, and networks trained on them for a few seconds, which no test may change."""

from pathlib import Path

import pytest

from drapeline.bodies.model import BodyModel
from drapeline.models.garment4d.body_input import BodySet
from drapeline.models.garment4d.canonical_stage import CanonicalStage
from drapeline.models.garment4d.data import SequenceData
from drapeline.models.garment4d.load import load_stage
from drapeline.models.garment4d.train import train_canonical, train_posed
from garment4d_stages import run_training
from garment4d_toys import CANONICAL, PLAIN, POSED, save_toy_data, toy_bodies


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory, toy_body: BodyModel) -> Path:
    """Holds `data`, as the rule `collect_garment4d` leaves it."""
    folder = tmp_path_factory.mktemp("garment4d")
    save_toy_data(folder / "data", toy_body)
    return folder


@pytest.fixture(scope="session")
def bodies(toy_body: BodyModel) -> BodySet:
    """Of which networks see 30 vertices."""
    return BodySet(toy_bodies(toy_body), 30)


@pytest.fixture
def data(folder: Path, bodies: BodySet) -> SequenceData:
    """Opened for one test, which may change it."""
    return SequenceData(folder / "data", bodies)


@pytest.fixture(scope="session")
def trained_canonical(folder: Path, bodies: BodySet) -> Path:
    """As the paper has it."""
    data = SequenceData(folder / "data", bodies)
    return run_training(train_canonical, folder, "canonical", data, PLAIN)


@pytest.fixture(scope="session")
def trained_body_relative(folder: Path, bodies: BodySet) -> Path:
    """A canonical stage whose points say where on the body they are."""
    data = SequenceData(folder / "data", bodies)
    return run_training(train_canonical, folder, "body_relative", data, CANONICAL)


@pytest.fixture(scope="session")
def trained_posed(folder: Path, bodies: BodySet, trained_canonical: Path) -> Path:
    """On `trained_canonical`."""
    data = SequenceData(folder / "data", bodies)
    stage = load_stage(trained_canonical, CanonicalStage)
    return run_training(train_posed, folder, "posed", data, POSED, stage)
