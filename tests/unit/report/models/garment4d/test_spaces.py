"""The spaces of canonical garments, drawn."""

from types import SimpleNamespace

import numpy as np

from drapeline.report.models.garment4d.spaces import plot_explained, plot_modes
from toys.gcvae import tube, tube_faces

TUBE, FACES = 2 * tube() - [0, 0, 0.6], tube_faces(False)


def test_modes_go_through_the_mean(made, tmp_path):
    components = np.stack([TUBE * [0.1, 0.1, 0], TUBE * [0, 0, 0.1]])
    space = SimpleNamespace(
        mean=TUBE, faces=FACES, components=components, explained=np.array([0.7, 0.2])
    )
    plot_modes(tmp_path / "modes.png", {"Skirt": space}, modes=5)
    assert len(made) == 10
    shapes = [parts[0].vertices - made[2][0].vertices for parts in made]
    for shape, deviation in zip(shapes[5:], (-2, -1, 0, 1, 2), strict=True):
        np.testing.assert_allclose(shape, deviation * components[1], atol=1e-9)


def test_explained_variance_says_how_many_components_suffice(tmp_path):
    space = SimpleNamespace(explained=np.array([0.6, 0.35, 0.04]))
    short = SimpleNamespace(explained=np.array([0.5]))
    plot_explained(tmp_path / "e.svg", {"Skirt": space, "Tshirt": short})
    text = (tmp_path / "e.svg").read_text()
    assert ">Skirt: 2 for 90 %<" in text
    assert ">Tshirt<" in text
