"""Toy skirts, and networks trained on them for a few seconds, which no test may change."""

from pathlib import Path

import pytest

from drapeline.bodies.model import BodyModel
from drapeline.learning_data.sequences import CloudData, GarmentSequence, SequenceData
from drapeline.models.garment4d.data import BodySequences, Seen
from drapeline.models.garment4d.ours.labels import LabelStage
from drapeline.models.garment4d.ours.model import OurModel
from drapeline.models.garment4d.stages import CanonicalStage, PosedStage, load_stage
from toys.garment4d import CANONICAL, LABELLING, POSED, open_toy_data, save_toy_data, save_toy_tops
from toys.garment4d_stages import build_canonical, fit_toy_model, train_toy_labels, train_toys


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Holds `data` and `labelled`, once `toy_skirts` was asked for, and trained networks."""
    return tmp_path_factory.mktemp("garment4d")


@pytest.fixture(scope="session")
def toy_skirts(folder: Path, toy_body: BodyModel) -> list[GarmentSequence]:
    """Nine skirts, written into `data` as the task `collect_data` does; all clouds besides."""
    save_toy_tops(folder / "labelled", toy_body)
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
    """The paper's first stage."""
    return train_toys(folder, "canonical", build_canonical(opened, CANONICAL), opened)


@pytest.fixture(scope="session")
def trained_posed(folder: Path, opened: BodySequences, trained_canonical: Path) -> Path:
    """On `trained_canonical`."""
    canonical = load_stage(trained_canonical, CanonicalStage)
    return train_toys(folder, "posed", PosedStage(PosedStage.SETTINGS(**POSED), canonical), opened)


@pytest.fixture(scope="session")
def trained_labels(folder: Path, toy_skirts: list[GarmentSequence]) -> Path:
    """Labels of our model."""
    return train_toy_labels(folder, "labels", folder / "labelled")


@pytest.fixture(scope="session")
def fitted_ours(folder: Path, opened: BodySequences, trained_labels: Path) -> Path:
    """Our model with `trained_labels`, in the folder of its garment type."""
    clouds = CloudData(folder / "labelled")
    return fit_toy_model(folder / "Skirt" / "ours", trained_labels, opened, clouds)


@pytest.fixture
def data(sequences: BodySequences) -> SequenceData:
    """Those sequences without their bodies."""
    return sequences.data


@pytest.fixture
def clouds(folder: Path, toy_skirts: list[GarmentSequence]) -> CloudData:
    """Clouds of all sequences."""
    return CloudData(folder / "labelled")


@pytest.fixture
def canonical(sequences: BodySequences) -> CanonicalStage:
    """Untrained."""
    return build_canonical(sequences, CANONICAL).eval()


@pytest.fixture
def identity(canonical: CanonicalStage) -> PosedStage:
    """Untrained: displacements are zero."""
    return PosedStage(PosedStage.SETTINGS(**POSED), canonical).eval()


@pytest.fixture
def labelling() -> LabelStage:
    """Untrained labels of our model."""
    return LabelStage(LabelStage.SETTINGS(**LABELLING)).eval()


@pytest.fixture
def ours(fitted_ours: Path) -> OurModel:
    """Our model, loaded for one test."""
    return OurModel(fitted_ours, "cpu")


@pytest.fixture
def held_out(data: SequenceData, sequences: BodySequences) -> Seen:
    """The sequence of the test split as models are given it: seven frames, windows of three."""
    return sequences.seen(int(data.of_split("test")[0]))
