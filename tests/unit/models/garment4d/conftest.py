"""Toy skirts, and networks trained on them for a few seconds, which no test may change."""

from pathlib import Path
from typing import Any

import pytest

from drapeline.bodies.model import BodyModel
from drapeline.learning_data.sequences import GarmentSequence, SequenceData
from drapeline.models.garment4d.data import BodySequences
from drapeline.models.garment4d.stages import CanonicalStage, PosedStage, load_stage
from toys.garment4d import CANONICAL, PLAIN, POSED, open_toy_data, save_toy_data
from toys.garment4d_stages import build_canonical, train_toys


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Holds `data`, once `toy_skirts` was asked for, and trained networks."""
    return tmp_path_factory.mktemp("garment4d")


@pytest.fixture(scope="session")
def toy_skirts(folder: Path, toy_body: BodyModel) -> list[GarmentSequence]:
    """Nine skirts, written into `data` as the rule `collect_garment4d` does."""
    return save_toy_data(folder / "data", toy_body)


@pytest.fixture
def sequences(
    folder: Path, toy_skirts: list[GarmentSequence], toy_body: BodyModel
) -> BodySequences:
    """Opened for one test, which may change them."""
    return open_toy_data(folder / "data", toy_body, 30)


@pytest.fixture(scope="session")
def opened(folder: Path, toy_skirts: list[GarmentSequence], toy_body: BodyModel) -> BodySequences:
    """Opened for the trainings below."""
    return open_toy_data(folder / "data", toy_body, 30)


@pytest.fixture(scope="session")
def trained_canonical(folder: Path, opened: BodySequences) -> Path:
    """As the paper has it."""
    return train_toys(folder, "canonical", build_canonical(opened, PLAIN), opened)


@pytest.fixture(scope="session")
def trained_body_relative(folder: Path, opened: BodySequences) -> Path:
    """A canonical stage whose points say where on the body they are."""
    return train_toys(folder, "body_relative", build_canonical(opened, CANONICAL), opened)


@pytest.fixture(scope="session")
def trained_posed(folder: Path, opened: BodySequences, trained_canonical: Path) -> Path:
    """On `trained_canonical`."""
    canonical = load_stage(trained_canonical, CanonicalStage)
    return train_toys(folder, "posed", PosedStage(PosedStage.SETTINGS(**POSED), canonical), opened)


@pytest.fixture
def data(sequences: BodySequences) -> SequenceData:
    """Those sequences without their bodies."""
    return sequences.data


@pytest.fixture
def canonical(sequences: BodySequences) -> CanonicalStage:
    """Untrained, as the paper has it."""
    return build_canonical(sequences, PLAIN).eval()


@pytest.fixture
def identity(canonical: CanonicalStage) -> PosedStage:
    """Untrained: displacements are zero."""
    return PosedStage(PosedStage.SETTINGS(**POSED), canonical).eval()


@pytest.fixture
def given(sequences: BodySequences) -> dict[str, Any]:
    """Arguments of `reconstruct` for the held-out sequence: seven frames, windows of three."""
    data = sequences.data
    sequence = int(data.of_split("test")[0])
    rows = data.rows(sequence)
    return {
        "points": data.points[rows],
        "poses": data.poses[rows],
        "body": sequences.body(sequence),
    }
