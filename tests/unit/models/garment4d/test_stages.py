"""Trainings of both stages, and the folders that they leave."""

import shutil

import numpy as np
import pytest
import torch

from drapeline.errors import DamagedFile, InputError
from drapeline.frames import GENDERS
from drapeline.models.garment4d.data import DressedSequences
from drapeline.models.garment4d.losses import balance_labels
from drapeline.models.garment4d.settings import CanonicalWeights, StageSettings
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    GarmentStage,
    MgnStage,
    PointNetStage,
    PosedStage,
    Stage,
    distance_mm,
    load_seen_forms,
    load_stage,
    save_seen_forms,
    window_keys,
)
from drapeline.models.layers.pointnet import PointLevel
from drapeline.models.training.batches import ByteCache, as_tensors
from drapeline.models.training.checkpoints import read_checkpoint, write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.settings import Settings
from drapeline.storage import save_npz
from toys.garment4d import CANONICAL, POSED, open_toy_data
from toys.garment4d_stages import batch_of, build_canonical, train_toys
from toys.histories import column
from toys.paper import printed


class ToyNetwork(Settings):
    size: int = 2


class ToySettings(StageSettings):
    network: ToyNetwork = ToyNetwork()
    loss: CanonicalWeights = CanonicalWeights()


class ToyStage(GarmentStage):
    checkpoint_type = "toy"
    SETTINGS, ERROR = ToySettings, "toy_error_mm"

    def __init__(self, settings, space, label):
        super().__init__(settings, space, label)
        draw = self.weight_rng()
        self.weight = torch.nn.Parameter(torch.rand(settings.network.size, generator=draw))

    def losses(self, batch):
        gap = self.weight.sum() - batch["target"]
        return {"squared": gap**2, "total": 3 * gap**2}, 1000 * gap.abs()

    @classmethod
    def from_metadata(cls, metadata):
        raise NotImplementedError


BATCH = {"target": torch.tensor(5.0), "names": ["a/1", "b/2"]}


@pytest.fixture
def toy(data):
    return ToyStage(ToyStage.SETTINGS(**{"network": {"size": 3}}), data.space, data.label)


def test_a_step_gives_the_total_and_logs_all_terms_and_the_error(toy):
    loss = toy.training_step(BATCH)
    (logged,) = toy.logged
    assert logged.rows == 2
    assert logged.values.keys() == {"train_squared", "train_total", "train_toy_error_mm"}
    assert float(logged.values["train_total"]) == float(loss.detach())
    loss.backward()
    assert toy.weight.grad.abs().min() > 0
    toy.validation_step(BATCH)
    assert toy.logged[1].values.keys() == {"val_squared", "val_total", "val_toy_error_mm"}


def test_a_loss_that_is_not_finite_is_refused(toy):
    with pytest.raises(InputError, match=r"the loss is nan .* for samples a/1, b/2"):
        toy.training_step({**BATCH, "target": torch.tensor(torch.nan)})


def test_initial_weights_depend_on_the_seed_alone(data):
    def weight(**training):
        values = {"network": {"size": 3}, "training": training}
        return ToyStage(ToyStage.SETTINGS(**values), data.space, data.label).weight

    assert torch.equal(weight(), weight(epochs=7))
    assert not torch.equal(weight(), weight(seed=1))


def test_checkpoints_hold_what_a_stage_is_built_from(toy, data):
    metadata = toy.checkpoint_metadata()
    assert (metadata["checkpoint_type"], metadata["label"]) == ("toy", data.label)
    assert ToyStage.SETTINGS(**metadata["settings"]) == toy.settings
    torch.testing.assert_close(metadata["space"]["mean"], torch.from_numpy(data.space.mean))


def test_windows_of_batches_are_told_by_sequence_and_first_frame():
    batch = {"sequence": torch.tensor([4, 4]), "start": torch.tensor([0, 3])}
    assert window_keys(batch) == [(4, 0), (4, 3)]


def test_distances_are_mean_lengths_in_millimetres():
    true = torch.zeros(2, 5, 3)
    predicted = true.clone()
    predicted[0, :, 0], predicted[0, :, 1] = 0.003, 0.004
    assert float(distance_mm(predicted, true)) == pytest.approx(2.5)


def test_the_error_that_is_logged_is_that_of_canonical_garments(trained_canonical, sequences):
    data, stage = sequences.data, load_stage(trained_canonical, CanonicalStage)
    batch = batch_of(stage, sequences, "val")
    with torch.no_grad():
        made = stage.network(batch["points"]).vertices.numpy()
    true = data.canonical[batch["sequence"]]
    expected = 1000 * np.linalg.norm(made - true, axis=-1).mean()
    best = np.argmin(column(trained_canonical, "val_total"))
    assert column(trained_canonical, "val_canonical_error_mm")[best] == pytest.approx(
        expected, rel=1e-3
    )


def test_searches_of_earlier_epochs_change_nothing(
    tmp_path, trained_canonical, sequences, monkeypatch
):
    monkeypatch.setattr("drapeline.models.garment4d.stages._KEPT_BYTES", 0)
    searched = train_toys(tmp_path, "searched", build_canonical(sequences, CANONICAL), sequences)
    for name in ("train_total", "val_total"):
        np.testing.assert_allclose(
            column(searched, name), column(trained_canonical, name), rtol=1e-5
        )


@pytest.mark.parametrize("cls", [CanonicalStage, PointNetStage])
def test_searches_of_earlier_epochs_are_not_repeated(sequences, cls, monkeypatch):
    stage = build_canonical(sequences, CANONICAL, cls)
    batch = batch_of(stage, sequences, "train")
    with torch.no_grad():
        first = stage.estimate(batch)
        monkeypatch.setattr("drapeline.models.layers.point_search._launch", None)
        again = stage.estimate(batch)
        with pytest.raises(TypeError):  # validation does not remember
            stage.eval().estimate(batch)
    for key in ("coefficients", "vertices"):
        assert torch.equal(getattr(again, key), getattr(first, key))


def test_weights_of_labels_come_from_the_data_and_are_loaded_again(tmp_path, sequences):
    data = sequences.data
    data.labels = np.where(np.arange(data.labels.shape[1]) % 3, data.labels, 0)
    values = {**CANONICAL, "training": {**CANONICAL["training"], "epochs": 1}}
    out = train_toys(tmp_path, "uneven", build_canonical(sequences, values), sequences)
    uneven = load_stage(out, CanonicalStage)
    expected = balance_labels(data.label_share("train"), 0.5)
    assert len(expected[expected > 0].unique()) > 1
    torch.testing.assert_close(uneven.label_weights, expected)


def test_the_error_that_is_logged_is_that_of_the_posed_garments(trained_posed, sequences):
    stage = load_stage(trained_posed, PosedStage)
    batch = batch_of(stage, stage.training_sequences(sequences), "val")
    assert set(sequences.data.source[batch["sequence"]]) == {"blender", "skinned"}
    with torch.no_grad():
        made = stage.predict(batch, stage.point_levels(batch))[-1]
    expected = 1000 * (made - batch["target"]).norm(dim=-1).mean()
    best = np.argmin(column(trained_posed, "val_total"))
    assert column(trained_posed, "val_vertex_error_mm")[best] == pytest.approx(
        float(expected), rel=1e-3
    )


def test_the_canonical_network_is_not_trained_further(trained_posed, trained_canonical):
    before = read_checkpoint(trained_canonical / BEST).weights
    after = read_checkpoint(trained_posed / BEST).weights
    for key, value in before.items():
        torch.testing.assert_close(after[f"canonical.{key}"], value, msg=key)


def test_sequences_are_dressed_in_what_the_canonical_network_predicts(trained_posed, sequences):
    stage = load_stage(trained_posed, PosedStage)
    dressed = stage.training_sequences(sequences)
    expected = stage.predict_canonicals(sequences.data, ("train", "val"))
    np.testing.assert_array_equal(dressed.canonical, expected)
    assert dressed.skinning == stage.settings.skinning
    window = np.array([[4, 1]])
    np.testing.assert_array_equal(dressed.batch(window, 3)["worn"], expected[4:5])


def test_point_levels_from_memory_are_those_of_the_network(trained_posed, sequences, monkeypatch):
    stage = load_stage(trained_posed, PosedStage)
    batch = batch_of(stage, sequences, "val")
    count = len(batch["names"])
    part = {key: value[: count - 1] for key, value in batch.items()}
    stage.point_levels(part)
    estimate = stage.estimate_canonical
    expected = estimate(batch["points"]).levels
    asked = []

    def counted(points):
        asked.append(len(points))
        return estimate(points)

    monkeypatch.setattr(stage, "estimate_canonical", counted)
    for _ in range(2):
        for one, true in zip(stage.point_levels(batch), expected, strict=True):
            for x, y in zip(one, true, strict=True):
                torch.testing.assert_close(x, y)
    assert asked == [1]
    # Without room everything is asked for anew.
    stage._levels = ByteCache(0)
    stage.point_levels(batch)
    stage.point_levels(batch)
    assert asked == [1, count, count]


def test_point_levels_from_memory_go_where_those_of_the_network_are(
    trained_posed, sequences, monkeypatch
):
    """Some were computed before the network was moved to where it is trained."""
    stage = load_stage(trained_posed, PosedStage)
    batch = batch_of(stage, sequences, "val")
    count = len(batch["names"])
    stage.point_levels({key: value[: count - 1] for key, value in batch.items()})
    estimate, cpu_points = stage.estimate_canonical, batch["points"]

    def elsewhere(points):
        found = estimate(cpu_points[-len(points) :])
        levels = [PointLevel(*(x.to("meta") for x in level)) for level in found.levels]
        return found._replace(levels=levels)

    monkeypatch.setattr(stage, "estimate_canonical", elsewhere)
    for level in stage.point_levels({**batch, "points": cpu_points.to("meta")}):
        assert {x.device.type for x in level} == {"meta"}


def test_windows_that_canonical_garments_were_predicted_from_are_not_asked_for_again(
    sequences, trained_posed, monkeypatch
):
    data, stage = sequences.data, load_stage(trained_posed, PosedStage)
    found = stage.predict_canonicals(data, ("val",))
    validated = data.of_split("val")
    np.testing.assert_array_equal(found[data.split == "test"], data.space.mean[None])
    batch = as_tensors(sequences.batch(data.windows("val", 3, 3), 3))
    for sequence in validated:
        points = batch["points"][batch["sequence"] == sequence]
        alpha = stage.estimate_canonical(points).coefficients.mean(0).numpy()
        np.testing.assert_allclose(found[sequence], data.space.vertices(alpha), atol=1e-5)
    expected = stage.estimate_canonical(batch["points"]).levels
    monkeypatch.setattr(stage, "estimate_canonical", None)
    for one, true in zip(stage.point_levels(batch), expected, strict=True):
        for x, y in zip(one, true, strict=True):
            torch.testing.assert_close(x, y)


def test_the_released_loss_of_the_posed_stage_sees_the_garment_alone(sequences, trained_canonical):
    values = {**POSED, "loss": {"laplacian_form": "released"}}
    posed = PosedStage(PosedStage.SETTINGS(**values), load_stage(trained_canonical, CanonicalStage))
    dressed = DressedSequences(sequences, sequences.data.canonical, posed.settings.skinning)
    batch = as_tensors(dressed.batch(sequences.data.windows("val", 3, 3), 3))
    with torch.no_grad():
        terms, _ = posed.losses(batch)
        others, _ = posed.losses({**batch, "target": 2 * batch["target"]})
    torch.testing.assert_close(terms["laplacian"], others["laplacian"])
    assert float(terms["laplacian"]) > 0
    assert float(others["vertices"]) > 1.1 * float(terms["vertices"])


def shortened(values, epochs):
    return {**values, "training": {**CANONICAL["training"], "epochs": epochs}}


def test_weights_stay_in_32_bits_when_products_are_taken_in_16(tmp_path, sequences):
    ends = []
    for precision in ("32-true", "bf16-mixed"):
        stage = build_canonical(sequences, shortened(CANONICAL, 1))
        out = train_toys(tmp_path, precision, stage, sequences, precision=precision)
        ends.append(read_checkpoint(out / BEST).weights)
    key = "network.encoder.coefficients.weight"
    assert not torch.equal(ends[0][key], ends[1][key])
    assert {value.dtype for value in ends[1].values() if value.is_floating_point()} == {
        torch.float32
    }


def test_baselines_are_trained_and_loaded(tmp_path, sequences, trained_canonical):
    stage = build_canonical(sequences, shortened(CANONICAL, 1), PointNetStage)
    out = train_toys(tmp_path, "pointnet", stage, sequences)
    stage = load_stage(out, CanonicalStage, PointNetStage)
    assert stage.checkpoint_type == "garment4d_pointnet"
    values = shortened({"network": {"widths": [8, 16]}, "loss": printed("garment4d.posed.loss")}, 1)
    stage = MgnStage(MgnStage.SETTINGS(**values), load_stage(trained_canonical, CanonicalStage))
    out = train_toys(tmp_path, "mgn", stage, sequences)
    stage = load_stage(out, MgnStage)
    assert stage.settings.skinning.neighbours == 1
    dressed = stage.training_sequences(sequences)
    # Copied weights are those of single body vertices.
    body = dressed.body(0).model.weights
    for row in dressed.weights(0)[::7]:
        assert np.abs(body - row).max(axis=1).min() < 1e-6


def test_two_trainings_end_with_the_same_weights(tmp_path, folder, opened, toy_body):
    ends = []
    for name in ("first", "second"):
        sequences = open_toy_data(folder / "data", toy_body, 30)
        stage = build_canonical(sequences, shortened(CANONICAL, 2))
        out = train_toys(tmp_path, name, stage, sequences)
        ends.append(read_checkpoint(out / BEST).weights)
    for key, value in ends[0].items():
        torch.testing.assert_close(value, ends[1][key], msg=key)


class Killed(Exception):
    """Stands for the signal."""


def kill_training(monkeypatch, *args):
    """Stop a training after its first epoch."""
    step = Stage.training_step

    def stop(stage, batch):
        if stage.progress.epoch == 1:
            raise Killed
        return step(stage, batch)

    with monkeypatch.context() as patched, pytest.raises(Killed):
        patched.setattr(Stage, "training_step", stop)
        train_toys(*args)


def first_epoch(monkeypatch, *args):
    """The epoch that a training of this name goes on from, 0 if it starts anew."""
    epochs, step = [], Stage.training_step

    def noted(stage, batch):
        epochs.append(stage.progress.epoch)
        return step(stage, batch)

    with monkeypatch.context() as patched:
        patched.setattr(Stage, "training_step", noted)
        train_toys(*args)
    return epochs[0]


def test_a_killed_training_goes_on_with_the_same_data_alone(
    tmp_path, folder, sequences, toy_body, monkeypatch
):
    def moved():
        """One point of one frame elsewhere."""
        copy = tmp_path / "moved data"
        shutil.copytree(folder / "data", copy)
        points = np.load(copy / "points.npy", mmap_mode="r+")
        points[5, 7] += 0.01
        points.flush()
        return open_toy_data(copy, toy_body, 30)

    for name, epoch, changed in (
        ("same", 1, lambda: open_toy_data(folder / "data", toy_body, 30)),
        ("moved", 0, moved),
        ("fewer_body_points", 0, lambda: open_toy_data(folder / "data", toy_body, 29)),
    ):
        values, again = shortened(CANONICAL, 2), changed()
        stage = build_canonical(sequences, values)
        kill_training(monkeypatch, tmp_path, name, stage, sequences)
        stage = build_canonical(again, values)
        assert first_epoch(monkeypatch, tmp_path, name, stage, again) == epoch


def test_a_killed_training_goes_on_with_the_same_canonical_network_alone(
    tmp_path, sequences, trained_canonical, monkeypatch
):
    settings = PosedStage.SETTINGS(**shortened(POSED, 2))
    for name, epoch in (("same", 1), ("other", 0)):
        canonical = load_stage(trained_canonical, CanonicalStage)
        stage = PosedStage(settings, canonical)
        kill_training(monkeypatch, tmp_path, name, stage, sequences)
        again = load_stage(trained_canonical, CanonicalStage)
        if name == "other":
            with torch.no_grad():
                again.network.encoder.coefficients.bias[0] += 1e-4
        stage = PosedStage(settings, again)
        assert first_epoch(monkeypatch, tmp_path, name, stage, sequences) == epoch


def test_a_loss_that_is_not_finite_names_the_windows(tmp_path, sequences):
    stage = build_canonical(sequences, CANONICAL)
    sequences.data.canonical = np.full_like(sequences.data.canonical, np.nan)
    with pytest.raises(InputError, match=r"loss is nan \(.*for samples 0000.*/1\d.*expected a fin"):
        train_toys(tmp_path, "nan", stage, sequences)
    assert not (tmp_path / "nan").exists()


def test_a_loaded_stage_says_what_was_validated_last(trained_posed, trained_canonical, sequences):
    stage = load_stage(trained_posed, PosedStage)
    assert not stage.training
    alone = load_stage(trained_canonical, CanonicalStage)
    for key, value in alone.state_dict().items():
        torch.testing.assert_close(value, stage.canonical.state_dict()[key], msg=key)
    # The history's validation errors are those of the weights that were kept.
    batch = batch_of(alone, sequences, "val")
    with torch.inference_mode():
        terms, _ = alone.losses(batch)
    assert float(terms["total"]) == pytest.approx(
        min(column(trained_canonical, "val_total")), rel=0.02
    )


def test_networks_of_other_types_and_missing_ones_are_refused(trained_canonical, tmp_path):
    with pytest.raises(InputError, match="holds a 'garment4d_canonical' network, expected"):
        load_stage(trained_canonical, PosedStage, MgnStage)
    with pytest.raises(InputError, match="no such file"):
        load_stage(tmp_path, PosedStage)


def test_a_template_whose_faces_name_vertices_that_are_not_there_is_refused(
    trained_canonical, tmp_path
):
    saved = read_checkpoint(trained_canonical / BEST)
    saved.metadata["space"]["faces"][0, 0] = 100_000
    write_checkpoint(tmp_path / BEST, *saved)
    with pytest.raises(DamagedFile, match=rf"{BEST}: .*'faces' names number 100000"):
        load_stage(tmp_path, CanonicalStage)


def test_an_untrained_stage_has_the_weights_that_its_training_began_with(
    trained_canonical, trained_posed, sequences
):
    for folder, cls in ((trained_canonical, CanonicalStage), (trained_posed, PosedStage)):
        trained = load_stage(folder, cls)
        before = {name: value.clone() for name, value in trained.state_dict().items()}
        begun = trained.untrained()
        assert not begun.training
        first = cls.from_metadata(trained.checkpoint_metadata())
        for name, value in first.network.state_dict().items():
            torch.testing.assert_close(begun.network.state_dict()[name], value, msg=name)
        weights = [
            torch.cat([p.flatten() for p in x.network.parameters()]) for x in (begun, trained)
        ]
        assert not torch.equal(*weights)
        # The trained one is as it was, and what it was built on is the same.
        for name, value in trained.state_dict().items():
            torch.testing.assert_close(value, before[name], msg=name)
            if not name.startswith("network."):
                torch.testing.assert_close(begun.state_dict()[name], value, msg=name)


def test_bodies_and_numbers_of_points_come_back(sequences, tmp_path):
    save_seen_forms(tmp_path, sequences)
    bodies, points = load_seen_forms(tmp_path)
    assert points == sequences.data.points.shape[1]
    assert bodies.count == sequences.bodies.count
    for name, array in sequences.bodies.arrays().items():
        np.testing.assert_array_equal(bodies.arrays()[name], array)


def test_a_missing_body_is_named(sequences, tmp_path):
    save_seen_forms(tmp_path, sequences)
    (tmp_path / "bodies" / f"{GENDERS[1]}.npz").unlink()
    with pytest.raises(InputError, match=r"male\.npz: no such file"):
        load_seen_forms(tmp_path)


def test_numbers_of_points_are_above_zero(tmp_path):
    save_npz(tmp_path / "reconstruction.npz", body_points=-1, points=5)
    with pytest.raises(InputError, match=r"reconstruction\.npz: 'body_points' is -1, expected at"):
        load_seen_forms(tmp_path)
