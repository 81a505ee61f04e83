"""Garments at rest, moved by networks of garments in motion that nobody has trained."""

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.sequence import untouched_sequence
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.learning_data.dynamic import HISTORY_FRAMES
from drapeline.learning_data.static import CONDITIONS
from drapeline.metrics.garment import garment_mesh
from drapeline.models.contract import MovingPerson
from drapeline.models.gcvae.movers import WornSheet, move_by_model
from drapeline.models.gcvae.representation import LearnedMover
from drapeline.models.gcvae.settings import DvaeSettings
from drapeline.models.gcvae.vae import DynamicVae, StaticVae
from drapeline.seeding import rng_for
from toys.gcvae_files import SETTINGS, shaken, template_on_body
from toys.moving import moving_data, moving_garment

FRAMES, NAMES = 14, ("Trousers", "Top")
# On average: of a few vertices, which face of the body is the nearest depends on the frames before.
SETTLED_M = 1e-4


@pytest.fixture(scope="module")
def bodies(toy_body):
    return {"female": toy_body, "male": toy_body}


@pytest.fixture(scope="module")
def static(toy_body):
    return shaken(StaticVae(SETTINGS, template_on_body(toy_body, CONDITIONS)))


@pytest.fixture(scope="module")
def model(toy_body):
    """One that sees all poses of a history."""
    conditions = CONDITIONS + 72 * HISTORY_FRAMES + SETTINGS.network.latent
    moving = SETTINGS.replace(training={"mask": False, "version": "unposed"})
    template = template_on_body(toy_body, conditions)
    return shaken(DynamicVae(DvaeSettings(**moving.plain()), template))


@pytest.fixture(scope="module")
def data(toy_body):
    garments = [moving_garment(toy_body, "test", name) for name in NAMES]
    return moving_data(garments, toy_body)


@pytest.fixture(scope="module")
def person(data, toy_body):
    """Wears a shell of the torso over another."""
    moving = moving_garment(toy_body, "test", NAMES[0])
    registered, rng = moving.registered, rng_for(0, "person")
    skin = rest_body(toy_body, moving.shape)
    worn = {
        name: garment_mesh(skin + layer * registered.offsets, toy_body.faces, registered.mask)
        for layer, name in enumerate(NAMES, 1)
    }
    poses = REST_POSE + np.cumsum(rng.normal(0, 0.05, (FRAMES, 72)), axis=0)
    trans = np.cumsum(rng.normal(0, 0.01, (FRAMES, 3)), axis=0)
    return MovingPerson("test0", "female", moving.shape, poses, trans, worn)


def move(model, static, data, person, body, *, settle, **frames):
    """Garment -> (F, V, 3) of a person's whole motion, or of some frames."""
    record = untouched_sequence(person.shape, person.gender, person.poses, person.trans)
    worn = {
        name: WornSheet(rest, rest, data.static[k], data.mask[k], data.cvar(np.array([k]))[0])
        for k, (name, rest) in enumerate(person.rest.items())
    }
    moved = move_by_model(model, static, worn, body, record, settle=settle, **frames)
    return {name: np.stack([one.vertices for one in sheet.frames]) for name, sheet in moved.items()}


@pytest.mark.parametrize("settle", [False, True])
def test_some_frames_are_those_of_the_whole_motion(model, static, data, person, toy_body, settle):
    whole, last = (
        move(model, static, data, person, toy_body, settle=settle, **frames)
        for frames in ({}, {"frames": slice(-2, None)})
    )
    for name in NAMES:
        assert len(whole[name]) == FRAMES
        apart = np.abs(last[name] - whole[name][-2:])
        assert apart.mean() < SETTLED_M if settle else apart.max() < 1e-6
        # They are not those of the first frames.
        assert np.abs(last[name] - whole[name][:2]).max() > 0.01


def test_a_learned_mover_gives_the_last_frame_of_the_motion(
    model, static, data, person, bodies, toy_body
):
    mover = LearnedMover({"one": model, "two": model}, static, data, bodies)
    found = mover.move(person)
    expected = move(model, static, data, person, toy_body, settle=True)
    assert found.keys() == {"one", "two"}
    for garments in found.values():
        assert [*garments] == [*NAMES]
        for name, mesh in garments.items():
            np.testing.assert_array_equal(mesh.faces, person.rest[name].faces)
            assert np.abs(mesh.vertices - expected[name][-1]).mean() < SETTLED_M


def test_a_motion_may_be_shorter_than_a_history(model, static, data, person, bodies, toy_body):
    short = person._replace(poses=person.poses[:2], trans=person.trans[:2])
    found = LearnedMover({"one": model}, static, data, bodies).move(short)["one"]
    expected = move(model, static, data, short, toy_body, settle=True)
    for name, mesh in found.items():
        assert np.abs(mesh.vertices - expected[name][-1]).mean() < SETTLED_M


@pytest.mark.parametrize(("sample", "garment"), [("test9", NAMES[0]), ("test0", "Dress")])
def test_a_garment_without_registration_is_named(
    model, static, data, person, bodies, sample, garment
):
    mover = LearnedMover({"one": model}, static, data, bodies)
    stranger = person._replace(sample=sample, rest={garment: person.rest[NAMES[0]]})
    with pytest.raises(InputError, match=f"no registration of {sample}'s {garment}, expected one"):
        mover.move(stranger)
