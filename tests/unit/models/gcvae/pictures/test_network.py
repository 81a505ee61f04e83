import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.gcvae.pictures import network
from drapeline.models.gcvae.pictures.network import CodeSpace, PictureCoder, load_coder
from drapeline.models.gcvae.pictures.views import CHANNELS, mirror_images
from drapeline.models.gcvae.settings import PictureNetwork
from drapeline.models.pictures.read import CLASSES
from drapeline.models.training.checkpoints import write_checkpoint
from drapeline.models.training.module import BEST, Progress
from toys.learning import shake_weights

SIZE, CODE = 32, 3
SKIRT = CLASSES.index("skirt")


def space():
    means = np.arange(len(CLASSES) * CODE, dtype=np.float32).reshape(-1, CODE)
    known = np.array([name == "skirt" for name in CLASSES])
    spread = np.array([1, 2, 3], np.float32)
    return CodeSpace(means, known, spread, np.float32([0.2, -0.4]), "abc")


@pytest.fixture
def coder():
    return PictureCoder(PictureNetwork(width=2), SIZE, space())


def batch(count=4):
    rng = torch.Generator().manual_seed(0)
    return {
        "images": torch.rand(count, CHANNELS, SIZE, SIZE, generator=rng),
        "kind": torch.full((count,), SKIRT),
        "z": torch.rand(count, CODE, generator=rng),
        "names": [str(number) for number in range(count)],
    }


def test_codes_start_near_the_mean_of_the_class(coder):
    given = batch()
    codes = coder.eval()(given["images"], given["kind"]).detach().numpy()
    away = np.abs(codes - space().means[SKIRT]) / space().spread
    assert away.max() < 0.5
    other = coder(given["images"], given["kind"] * 0).detach().numpy()
    assert other == pytest.approx(codes - space().means[SKIRT] + space().means[0], abs=1e-5)


def test_the_loss_is_a_share_of_the_distance_from_the_mean(coder):
    given = batch()
    with torch.no_grad():
        coder.network.fc.weight.zero_()
    mean = torch.from_numpy(space().means[SKIRT])
    spread = torch.from_numpy(space().spread)
    given["z"] = mean + spread * torch.tensor([[1.0, 1, 1], [-1, 1, -1], [1, -1, 1], [1, 1, -1]])
    coder.validation_step(given)
    assert float(coder.logged[-1].values["val_loss"]) == pytest.approx(1, rel=1e-5)


def test_some_pictures_of_a_step_are_mirrored_others_in_another_step(coder, monkeypatch):
    seen = []
    monkeypatch.setattr(network, "hide_parts", lambda images, _: images)
    monkeypatch.setattr(coder, "_loss", lambda images, _: seen.append(images) or images.sum() * 0)
    given = batch(12)
    for step in (0, 0, 1):
        coder.progress = Progress(step=step)
        coder.training_step(given)
    mirrored = mirror_images(given["images"])
    for images in seen:
        either = [
            torch.equal(one, own) or torch.equal(one, turned)
            for one, own, turned in zip(images, given["images"], mirrored, strict=True)
        ]
        assert all(either)
    assert torch.equal(seen[0], seen[1])
    assert not torch.equal(seen[0], seen[2])


def test_a_checkpoint_gives_the_network_back(coder, tmp_path):
    shake_weights(coder, 0.1)
    write_checkpoint(tmp_path / BEST, coder.state_dict(), coder.checkpoint_metadata())
    loaded = load_coder(tmp_path)
    given = batch()
    torch.testing.assert_close(
        loaded(given["images"], given["kind"]), coder.eval()(given["images"], given["kind"])
    )
    assert loaded.model == "abc"
    for own, other in zip(loaded.space, space(), strict=True):
        np.testing.assert_array_equal(own, other)


def test_another_network_is_refused(coder, tmp_path):
    about = {**coder.checkpoint_metadata(), "checkpoint_type": "static"}
    write_checkpoint(tmp_path / BEST, coder.state_dict(), about)
    with pytest.raises(InputError, match="holds a 'static' network, expected picture_code"):
        load_coder(tmp_path)
