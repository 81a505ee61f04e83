"""Labels of points: the network, its training, and the clouds that it is trained on."""

import json

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.learning_data.sequences import CloudData, collect_clouds
from drapeline.models.garment4d.losses import balance_labels
from drapeline.models.garment4d.ours.body_maps import body_map
from drapeline.models.garment4d.ours.labels import (
    LabelledClouds,
    LabelModel,
    LabelNetwork,
    LabelStage,
    choose_labels,
    map_heights,
)
from drapeline.models.garment4d.settings import LabelStageSettings
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    keep_bodies,
    load_kept_bodies,
    load_stage,
)
from drapeline.models.load import load
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.checkpoints import read_checkpoint, write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENT_TYPES, LABELS
from drapeline.seeding import rng_for
from toys.garment4d import LABELLING, save_toy_tops, toy_bodies, toy_sequences
from toys.garment4d_stages import train_toy_labels
from toys.histories import column

SETTINGS = LabelStageSettings(**LABELLING).network
BOTH = ("simulated", "skinned")


def draw(seed=0):
    return torch.Generator().manual_seed(seed)


@pytest.fixture
def network():
    return LabelNetwork(SETTINGS, draw()).eval()


def clouds(count, frames=3, points=90, seed=1):
    """Points (B, T, P, 3), their places (B, T, P, 4) on the body, and maps (B, cells) of heights.

    The maps are of these frames, as if there were no others.
    """
    rng = draw(seed)
    place = torch.rand(count, frames, points, 3, generator=rng) - 0.5
    height = torch.rand(count, frames, points, 1, generator=rng)
    on_body = torch.cat([place, height], -1)
    heights = torch.stack([torch.from_numpy(map_heights(each.numpy())) for each in on_body])
    return place + 0.1 * torch.randn(place.shape, generator=rng), on_body, heights


# ---- the network ------------------------------------------------------------------------------


def test_every_point_has_a_logit_of_every_label(network):
    assert network(*clouds(2)).shape == (2, 3, 90, len(LABELS))


def test_the_order_of_points_and_of_frames_does_not_matter(network):
    points, on_body, heights = clouds(2)
    plain = network(points, on_body, heights)
    order = torch.randperm(90, generator=draw(2))
    mixed = network(points[:, :, order], on_body[:, :, order], heights)
    torch.testing.assert_close(mixed, plain[:, :, order])
    back = network(points.flip(1), on_body.flip(1), heights)
    torch.testing.assert_close(back.flip(1), plain)


def test_a_batch_is_its_windows_one_by_one(network):
    given = clouds(3)
    whole = network(*given)
    for window in range(3):
        one = network(*(each[window : window + 1] for each in given))
        torch.testing.assert_close(one[0], whole[window])


def test_all_labels_depend_on_places_on_the_body_and_on_the_map(network):
    points, on_body, heights = clouds(1)
    plain = network(points, on_body, heights)
    for changed in ((points, on_body + 0.1, heights), (points, on_body, heights + 0.1)):
        assert ((network(*changed) - plain).abs().amax(-1) > 1e-7).all()


def test_a_map_of_heights_is_of_all_frames_in_any_order():
    _, (on_body, _), _ = clouds(2)
    found = map_heights(on_body.numpy())
    expected = body_map(on_body.flatten(0, 1)[None], on_body.flatten(0, 1)[None, :, 3:], 1, 0.05)
    np.testing.assert_allclose(found, expected[0].numpy(), atol=1e-6)
    order = torch.randperm(90, generator=draw(2))
    mixed = map_heights(on_body.flip(0)[:, order].numpy())
    np.testing.assert_allclose(mixed, found, atol=1e-6)


def test_every_parameter_gets_a_gradient(network):
    labels = torch.randint(len(LABELS), (2, 3, 90), generator=draw(3))
    logits = network.train()(*clouds(2))
    torch.nn.functional.cross_entropy(logits.flatten(0, 2), labels.flatten()).backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.any(), name


def test_weights_come_from_the_generator_alone():
    states = [
        torch.cat([p.flatten() for p in LabelNetwork(SETTINGS, draw(seed)).parameters()])
        for seed in (3, 3, 4)
    ]
    assert torch.equal(states[0], states[1])
    assert not torch.equal(states[0], states[2])


# ---- what is worn together --------------------------------------------------------------------

WORN = {
    "Dress": {"Body", "Dress"},
    "Jumpsuit": {"Body", "Jumpsuit"},
    "Skirt": {"Body", "Skirt", "Top", "Tshirt", "Jacket"},
    "Trousers": {"Body", "Trousers", "Top", "Tshirt", "Jacket"},
    "Tshirt": {"Body", "Tshirt", "Trousers", "Skirt", "Jacket"},
    "Top": {"Body", "Top", "Trousers", "Skirt", "Jacket"},
}


@pytest.mark.parametrize("garment", WORN)
def test_nothing_is_taken_for_what_is_not_worn_together_with_the_garment(garment):
    logits = rng_for(0, "logits").normal(size=(3, 200, len(LABELS))).astype(np.float32)
    found = choose_labels(logits, garment)
    assert (found.shape, found.dtype) == ((3, 200), np.uint8)
    assert {LABELS[label] for label in np.unique(found)} == WORN[garment]
    # What is not worn and covers the same part of the body has been taken for the garment.
    share, own = np.exp(logits.astype(np.float64)), LABELS.index(garment)
    region = GARMENT_TYPES[garment].region
    for label, name in enumerate(LABELS[1:], 1):
        if name not in WORN[garment]:
            if region in ("whole", GARMENT_TYPES[name].region):
                share[..., own] += share[..., label]
            share[..., label] = 0
    np.testing.assert_array_equal(found, share.argmax(axis=-1))


@pytest.mark.parametrize(
    ("garment", "taken_for"),
    [
        ("Tshirt", "Top"),
        ("Top", "Tshirt"),
        ("Skirt", "Trousers"),
        ("Trousers", "Skirt"),
        *(("Dress", name) for name in ("Tshirt", "Top", "Skirt", "Trousers", "Jumpsuit")),
    ],
)
def test_what_is_mixed_up_with_the_garment_counts_as_it(garment, taken_for):
    sure = 9.0 * np.eye(len(LABELS))[[LABELS.index(taken_for)]]
    assert choose_labels(sure, garment).tolist() == [LABELS.index(garment)]


@pytest.mark.parametrize("garment", LABELS[1:])
def test_skin_and_the_garment_itself_are_always_possible(garment):
    sure = 9.0 * np.eye(len(LABELS))[[0, LABELS.index(garment)]]
    assert choose_labels(sure, garment).tolist() == [0, LABELS.index(garment)]


# ---- clouds to learn from ---------------------------------------------------------------------


@pytest.fixture
def everyone(toy_body, tmp_path):
    """Clouds of people in skirts, and of one who wears none."""
    save_toy_tops(tmp_path / "labelled", toy_body)
    return CloudData(tmp_path / "labelled")


def names_of(batch):
    """Of the sequences of a batch's windows."""
    return [name.partition("/")[0] for name in batch["names"]]


def windows_of(labelled, data, split):
    """Sequence, rows of the data, and row in the batch as it is and worse, of each window."""
    batch = labelled.batch(labelled.rows(split))
    for row in range(0, len(batch["names"]), 2):
        sequence = data.name.tolist().index(names_of(batch)[row])
        own = data.rows(sequence)
        frames = batch["points"].shape[1]
        (first,) = [
            first
            for first in range(own.start, own.stop - frames + 1)
            if np.array_equal(data.points[first : first + frames], batch["points"][row])
        ]
        yield sequence, slice(first, first + frames), row


@pytest.mark.parametrize("split", ["train", "val"])
def test_every_window_is_there_as_it_is_and_worse(everyone, split):
    labelled = LabelledClouds(everyone, frames=3, stride=2, sources=BOTH)
    batch = labelled.batch(labelled.rows(split))
    assert batch["labels"].dtype == np.int64
    assert (batch["points"][::2] != batch["points"][1::2]).any(axis=(1, 2, 3)).all()
    count = 0
    for sequence, span, row in windows_of(labelled, everyone, split):
        whole = everyone.rows(sequence)
        for one, points, labels, places in (
            (row, everyone.points, everyone.labels, everyone.on_body),
            (row + 1, everyone.worse_points, everyone.worse_labels, everyone.on_worse_body),
        ):
            np.testing.assert_array_equal(batch["points"][one], points[span])
            np.testing.assert_array_equal(batch["labels"][one], labels[span])
            np.testing.assert_array_equal(batch["on_body"][one], places[span])
            np.testing.assert_array_equal(batch["heights"][one], map_heights(places[whole]))
            assert names_of(batch)[one] == everyone.name[sequence]
            count += 1
    assert count == len(labelled.rows(split)) == len(batch["names"])


def test_windows_are_of_all_sequences_of_a_split_whatever_is_worn(everyone):
    labelled = LabelledClouds(everyone, frames=3, stride=3, sources=BOTH)
    expected = {"train": {f"{n:05d}" for n in (0, 1, 2, 3, 4, 5, 20)}, "val": {"00006", "00007"}}
    for split, names in expected.items():
        assert set(names_of(labelled.batch(labelled.rows(split)))) == names
    assert everyone.name[everyone.of_split("test")].tolist() == ["00008"]


def test_rows_are_told_by_which_they_are(everyone):
    """By which searches among their points are remembered."""
    labelled = LabelledClouds(everyone, frames=3, stride=1, sources=BOTH)
    train, val = (labelled.rows(split) for split in ("train", "val"))
    assert len({*train.tolist(), *val.tolist()}) == len(train) + len(val)
    some = train[[5, 2, 9]]
    np.testing.assert_array_equal(labelled.batch(some)["window"], some)
    for one, row in zip(labelled.batch(some)["points"], some, strict=True):
        np.testing.assert_array_equal(one, labelled.batch(np.array([row]))["points"][0])


def test_sources_are_those_of_training_sequences(everyone):
    labelled = LabelledClouds(everyone, frames=3, stride=3, sources=("simulated",))
    trained = labelled.batch(labelled.rows("train"))
    assert set(names_of(trained)) == {"00004", "00005", "00020"}
    # What is selected by is not less for it.
    validated = labelled.batch(labelled.rows("val"))
    assert set(names_of(validated)) == {"00006", "00007"}


def test_training_windows_are_a_stride_apart_and_validation_windows_few(everyone):
    labelled = LabelledClouds(everyone, frames=2, stride=1, sources=BOTH)

    def starts(split, name):
        wanted = everyone.name.tolist().index(name)
        found = windows_of(labelled, everyone, split)
        return [s.start - everyone.start[wanted] for one, s, _ in found if one == wanted]

    assert starts("train", "00004") == list(range(7))
    assert starts("train", "00000") == [0, 1]
    # Of seven frames, at 0, 2, 4 and 5, no more than three count.
    assert len(starts("val", "00007")) == 3
    assert starts("val", "00007")[::2] == [0, 5]


def test_a_sequence_shorter_than_a_window_is_named(everyone):
    with pytest.raises(InputError, match="sequence 00000 has 3 frames, expected at least 4"):
        LabelledClouds(everyone, frames=4, stride=4, sources=BOTH)


def test_shares_of_labels_are_those_of_the_training_points_of_the_sources(everyone):
    for sources, names in (
        (BOTH, ("00000", "00001", "00002", "00003", "00004", "00005", "00020")),
        (("simulated",), ("00004", "00005", "00020")),
    ):
        rows = [everyone.rows(everyone.name.tolist().index(name)) for name in names]
        points = np.concatenate([everyone.labels[own].ravel() for own in rows])
        labelled = LabelledClouds(everyone, frames=3, stride=3, sources=sources)
        expected = np.bincount(points, minlength=len(LABELS)) / len(points)
        np.testing.assert_allclose(labelled.label_share(), expected)
        assert labelled.label_share()[LABELS.index("Top")] > 0


# ---- the stage --------------------------------------------------------------------------------


@pytest.fixture
def labelled(clouds):
    return LabelledClouds(clouds, frames=3, stride=3, sources=BOTH)


@pytest.fixture
def batch(labelled):
    """Two training windows, each as it is and worse."""
    return as_tensors(labelled.batch(labelled.rows("train")[8:12]))


def logits_of(stage, batch):
    with torch.no_grad():
        return stage.network(batch["points"], batch["on_body"], batch["heights"])


def test_the_loss_is_the_balanced_cross_entropy_and_the_error_the_share_of_wrong_labels(
    labelling, batch
):
    labelling.label_weights.copy_(torch.linspace(0.5, 2, len(LABELS)))
    with torch.no_grad():
        terms, wrong = labelling.losses(batch)
    logits = logits_of(labelling, batch)
    right = logits.log_softmax(-1).gather(-1, batch["labels"][..., None])[..., 0]
    weights = labelling.label_weights[batch["labels"]]
    torch.testing.assert_close(terms["total"], -(weights * right).mean())
    taken = logits.numpy().argmax(-1)
    assert float(wrong) == pytest.approx((taken != batch["labels"].numpy()).mean())


STARTS = (0, 3, 4)  # of windows of three frames that cover seven


def test_logits_of_a_sequence_are_the_means_of_the_windows_that_hold_a_frame(labelling, data):
    rows = data.rows(int(data.of_split("test")[0]))
    points, on_body = (np.array(each[rows]) for each in (data.points, data.on_body))
    heights = torch.from_numpy(map_heights(on_body))[None]
    total, held = np.zeros((*points.shape[:2], len(LABELS))), np.zeros(len(points))
    for start in STARTS:
        span = slice(start, start + 3)
        with torch.no_grad():
            given = (torch.from_numpy(each[None, span]) for each in (points, on_body))
            total[span] += labelling.network(*given, heights)[0].numpy()
        held[span] += 1
    found = labelling.logits(points, on_body)
    np.testing.assert_allclose(found, total / held[:, None, None], atol=1e-5)
    with pytest.raises(InputError, match="2 frames, expected at least 3"):
        labelling.logits(points[:2], on_body[:2])


def test_a_sleeve_decides_about_points_out_of_its_reach(labelling, data):
    """All labels of a sequence may change with the height of points on an arm, in any frame."""
    rows = data.rows(int(data.of_split("test")[0]))
    points, on_body = (np.array(each[rows]) for each in (data.points, data.on_body))
    on_body[-1, 0] = [0.6, 0.0, 0.4, 0.0]
    raised = on_body.copy()
    raised[-1, 0, 3] = 2.0
    first, second = (labelling.logits(points, each) for each in (on_body, raised))
    assert (np.abs(first - second).max(-1) > 1e-7).all()


def test_labels_are_balanced_by_their_share_of_the_training_points(labelling, labelled):
    labelling.prepare(labelled)
    expected = balance_labels(labelled.label_share(), 0.5)
    torch.testing.assert_close(labelling.label_weights, expected)


def test_searches_of_earlier_epochs_are_not_repeated(labelling, labelled, batch, monkeypatch):
    with torch.no_grad():
        wanted = labelling.train().losses(batch)
        monkeypatch.setattr("drapeline.models.layers.point_search._launch", None)
        # Each epoch has them in another order.
        rows = labelled.rows("train")[8:12][::-1].copy()
        found = labelling.losses(as_tensors(labelled.batch(rows)))
        with pytest.raises(TypeError):  # of other windows there are none
            labelling.losses(as_tensors(labelled.batch(labelled.rows("train")[:2])))
        with pytest.raises(TypeError):  # validation does not remember
            labelling.eval().losses(batch)
    torch.testing.assert_close(found[0]["total"], wanted[0]["total"])


def test_initial_weights_depend_on_the_seed_alone():
    def weights(**training):
        stage = LabelStage(LabelStageSettings(**{**LABELLING, "training": training}))
        return torch.cat([p.flatten() for p in stage.parameters()])

    assert torch.equal(weights(), weights(epochs=7))
    assert not torch.equal(weights(), weights(seed=1))


def test_a_stage_that_is_stored_says_the_same_again(labelling, labelled, batch, tmp_path):
    labelling.prepare(labelled)
    write_checkpoint(tmp_path / BEST, labelling.state_dict(), labelling.checkpoint_metadata())
    again = load_stage(tmp_path, LabelStage)
    assert not again.training
    assert again.settings == labelling.settings
    assert torch.equal(logits_of(again, batch), logits_of(labelling, batch))
    torch.testing.assert_close(again.label_weights, labelling.label_weights)


def test_the_stage_that_is_kept_is_that_of_the_least_error_in_validation(trained_labels, labelled):
    stage = load_stage(trained_labels, LabelStage)
    assert stage.settings == LabelStageSettings(**LABELLING)
    batch = as_tensors(labelled.batch(labelled.rows("val")))
    with torch.no_grad():
        terms, wrong = stage.losses(batch)
    best = np.argmin(column(trained_labels, "val_total"))
    assert column(trained_labels, "val_total")[best] == pytest.approx(
        float(terms["total"]), rel=0.02
    )
    assert column(trained_labels, "val_wrong_share")[best] == pytest.approx(float(wrong), abs=0.02)
    torch.testing.assert_close(
        stage.label_weights, balance_labels(labelled.label_share(), LABELLING["loss"]["balance"])
    )


BRIEF = {**LABELLING, "training": {**LABELLING["training"], "epochs": 1}}


def test_two_trainings_with_all_clouds_end_with_the_same_weights(everyone, tmp_path):
    first, second = (
        read_checkpoint(train_toy_labels(tmp_path, name, tmp_path / "labelled", BRIEF) / BEST)
        for name in ("first", "second")
    )
    assert first.weights.keys() == second.weights.keys()
    for key, value in first.weights.items():
        torch.testing.assert_close(value, second.weights[key], msg=key)


def test_a_training_is_told_by_its_clouds(trained_labels, folder, toy_body, tmp_path):
    collect_clouds(tmp_path / "fewer", toy_sequences(toy_body), toy_bodies(toy_body))

    def digest(out):
        return json.loads((out / "settings.json").read_text())["data"]

    same, other = (
        train_toy_labels(tmp_path, name, data, BRIEF)
        for name, data in (("same", folder / "labelled"), ("other", tmp_path / "fewer"))
    )
    assert digest(same) == digest(trained_labels) != digest(other)


def test_networks_of_other_stages_are_refused(trained_labels, trained_canonical):
    with pytest.raises(
        InputError, match="holds a 'garment4d_labels' network, expected garment4d_c"
    ):
        load_stage(trained_labels, CanonicalStage)
    with pytest.raises(InputError, match="holds a 'garment4d_canonical' network, expected garment"):
        load_stage(trained_canonical, LabelStage)


# ---- the trained network in use ---------------------------------------------------------------


@pytest.fixture
def model(labelling, toy_body, tmp_path):
    write_checkpoint(tmp_path / BEST, labelling.state_dict(), labelling.checkpoint_metadata())
    keep_bodies(tmp_path, toy_bodies(toy_body))
    return LabelModel(tmp_path, "cpu")


@pytest.fixture
def seen(toy_body):
    """Clouds of somebody in a skirt, and what is told of the body."""
    one = toy_sequences(toy_body)[-1]
    return one.points, {"poses": one.poses, "shape": one.shape, "gender": one.gender}


def test_labels_are_the_likeliest_by_the_stages_logits(model, labelling, seen, toy_body):
    points, about = seen
    found = model.label(points, **about)
    assert (found.shape, found.dtype) == (points.shape[:2], np.uint8)
    assert found.max() < len(model.names) == len(LABELS)
    places = body_relative_points(toy_body, about["shape"], about["poses"], points)
    logits = labelling.logits(points, places[..., 3:])
    np.testing.assert_array_equal(found, logits.argmax(-1))
    skirt = model.label(points, **about, garment="Skirt")
    np.testing.assert_array_equal(skirt, choose_labels(logits, "Skirt"))
    assert {model.names[label] for label in np.unique(skirt)} <= WORN["Skirt"]


def test_labels_are_the_same_wherever_the_body_stands(model, seen):
    points, about = seen
    trans = np.linspace([1.0, 2.0, 0.5], [1.5, 2.0, 0.75], len(points))
    moved = model.label(points + trans[:, None], **about, trans=trans)
    assert (moved == model.label(points, **about)).mean() > 0.99  # of rounded coordinates


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"garment": "Kilt"}, "garment: 'Kilt', expected one of Tshirt"),
        ({"garment": "Body"}, "garment: 'Body', expected one of Tshirt"),
        ({"points": np.zeros((7, 90, 2))}, r"frame 1: points have shape \(90, 2\)"),
        ({"poses": np.zeros((7, 24, 3))}, r"poses has shape \(7, 24, 3\)"),
        ({"poses": np.zeros((6, 72))}, "7 frames, but 6 poses; expected equal numbers"),
        ({"shape": np.zeros(9)}, r"shape has shape \(9,\)"),
        ({"trans": np.zeros((7, 2))}, r"trans has shape \(7, 2\)"),
        ({"trans": np.ones((7, 3))}, "from the body, expected at most"),
        ({"gender": "x"}, "gender is 'x', expected female"),
    ],
)
def test_what_cannot_be_labelled_is_refused(model, seen, changed, sentence):
    points, about = seen
    with pytest.raises(InputError, match=sentence) as refused:
        model.label(**{"points": points, **about, **changed})
    assert "\n" not in str(refused.value)


def test_clouds_of_different_sizes_and_few_of_them_are_refused(model, seen):
    points, about = seen
    with pytest.raises(InputError, match="points: clouds of 159 to 160 points, expected as many"):
        model.label([points[0, 1:], *points[1:]], **about)
    few = {**about, "poses": about["poses"][:2]}
    with pytest.raises(InputError, match="2 frames, expected at least 3"):
        model.label(points[:2], **few)


def test_trained_labels_are_loaded_with_the_bodies_that_they_were_trained_with(
    trained_labels, toy_body
):
    model = load(trained_labels)
    assert isinstance(model, LabelModel)
    for body in (*model.bodies.values(), *load_kept_bodies(trained_labels).values()):
        np.testing.assert_array_equal(body.v_template, toy_body.v_template)
        assert body.name == toy_body.name
