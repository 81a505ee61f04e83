"""Reconstructions in files, and which of them are shown."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.metrics.predictions import (
    Reconstruction,
    first_reconstructions,
    load_reconstruction,
)
from drapeline.seeding import rng_for
from drapeline.storage import save_npz


def test_reconstructions_survive_a_file(tmp_path):
    rng = rng_for(0, "garment4d file")
    cloth, body = rng.normal(size=(2, 4, 3)), rng.normal(size=(2, 5, 3))
    made = Reconstruction(
        name="00001",
        garment="Skirt",
        faces=np.array([[0, 1, 3]]),
        canonical=cloth[0],
        proposal=cloth,
        final=cloth + 1,
        true=np.zeros((0, 3)),
        true_canonical=np.zeros((0, 3)),
        points=rng.normal(size=(2, 6, 3)),
        labels=np.zeros((2, 6), np.uint8),
        body=body,
        rest_body=body[0],
        body_faces=np.array([[0, 1, 4]]),
        root_rotation=np.zeros((2, 3)),
        root_height=np.zeros(2),
        number=np.arange(2),
    )
    made.save(tmp_path / "r.npz")
    back = load_reconstruction(tmp_path / "r.npz")
    assert (back.name, back.garment) == ("00001", "Skirt")
    assert back.true.shape == (0, 3)
    np.testing.assert_array_equal(back.number, made.number)
    save_npz(tmp_path / "r.npz", name="00001")
    with pytest.raises(InputError, match="garment"):
        load_reconstruction(tmp_path / "r.npz")


def test_of_each_type_with_a_reconstruction_the_first_is_shown_in_both_variants(tmp_path):
    folders = [tmp_path / name for name in ("Skirt", "Tshirt", "Trousers")]
    for folder, names in zip(folders, (["00002", "00001"], [], ["x"]), strict=True):
        folder.mkdir()
        for name in names:
            for file in (f"{name}.npz", f"{name}_ours.npz"):
                (folder / file).touch()
    assert first_reconstructions(folders) == [
        (folders[0] / "00001.npz", folders[0] / "00001_ours.npz"),
        (folders[2] / "x.npz", folders[2] / "x_ours.npz"),
    ]
    with pytest.raises(InputError, match="Tshirt: no sequence of any type is in the test split"):
        first_reconstructions(iter(folders[1:2]))
