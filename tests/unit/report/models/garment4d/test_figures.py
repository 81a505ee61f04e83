"""Figures 4 and 5 of Garment4D: what is in the pictures, not that there are any."""

from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from drapeline.frames import REST_POSE
from drapeline.metrics.predictions import Reconstruction
from drapeline.outfits.garment_types import LABELS
from drapeline.report.colours import garment_colour
from drapeline.report.models.garment4d.figures import (
    STEP_COLUMNS,
    SkinnedTwice,
    animate_steps,
    cloud_parts,
    plot_explained,
    plot_modes,
    plot_neighbours,
    plot_results,
    plot_steps,
    step_cells,
    worst_place,
)
from drapeline.report.models.scene import Scene, spread_frames
from drapeline.seeding import rng_for
from toys.gcvae import tube, tube_faces

TUBE, FACES = 2 * tube() - [0, 0, 0.6], tube_faces(False)


def case(frames=3, *, truth=True, garment="Skirt"):
    """A tube that lengthens, worn by a wider one on the floor; LBS 40 mm off, final 10 mm."""
    rng = rng_for(0, "garment4d figures")
    true = TUBE * (1 + 0.1 * np.arange(frames)[:, None, None] * [0.0, 0.0, 1.0])
    body = 1.1 * true
    return Reconstruction(
        name="00007",
        garment=garment,
        faces=FACES,
        canonical=TUBE + [0, 0.02, 0],
        proposal=true + [0.04, 0, 0],
        final=true + [0, 0, 0.01],
        true=true if truth else true[:0],
        true_canonical=TUBE if truth else TUBE[:0],
        points=rng.normal(size=(frames, 50, 3)),
        labels=np.tile(np.arange(50) % 2 * LABELS.index(garment), (frames, 1)),
        body=body,
        rest_body=1.1 * TUBE,
        body_faces=FACES,
        root_rotation=np.tile(REST_POSE[:3], (frames, 1)),
        root_height=-body[..., 2].min(axis=1),
        number=10 * np.arange(frames),
    )


def test_cloud_has_a_ball_per_point_in_its_colour_paler_in_the_distance():
    rng = rng_for(0, "cloud")
    points = rng.normal(size=(300, 3))
    labels = rng.integers(0, 2, 300) * LABELS.index("Skirt")
    parts = cloud_parts(points, labels, Scene(front=(0.0, -1.0), turn_deg=0.0))
    centres = np.concatenate([p.vertices.reshape(-1, 12, 3).mean(axis=1) for p in parts])
    np.testing.assert_allclose(np.sort(centres[:, 0]), np.sort(points[:, 0]), atol=1e-9)
    near = min(parts, key=lambda p: np.abs(np.array(p.colour) - garment_colour("Skirt")).max())
    np.testing.assert_allclose(near.colour, garment_colour("Skirt"))
    far = max(parts, key=lambda p: p.vertices[:, 1].mean())
    assert near.vertices[:, 1].mean() < -1 < 1 < far.vertices[:, 1].mean()
    assert np.ptp(far.colour) < 0.5 * np.ptp(near.colour)


def test_balls_shrink_as_points_become_many():
    few, many = (
        np.ptp(cloud_parts(np.zeros((n, 3)), np.zeros(n, int), Scene())[0].vertices[:12, 0])
        for n in (500, 2000)
    )
    assert few == pytest.approx(2 * many)


def test_steps_show_each_stage_on_its_frame_with_its_error(made):
    shown = case()
    cells = step_cells(shown, 1, 0, Scene())
    assert len(cells) == len(made) == len(STEP_COLUMNS)
    garments = [parts[1].vertices for parts in made[2:5]]
    for garment, expected in zip(garments, (shown.proposal, shown.final, shown.true), strict=True):
        np.testing.assert_allclose(garment, expected[1])
    assert [cell.caption for cell in cells] == ["", "", "", "", "", "40.0 mm", "10.0 mm"]


def test_canonical_column_has_the_estimate_its_error_and_the_registered_one(made):
    shown = case(5)
    cells = [step_cells(shown, row, row, Scene())[1] for row in range(4)]
    assert [c and c.caption for c in cells] == ["", "its error: 20.0 mm", "registered", None]
    estimated, registered = made[1], made[15]
    np.testing.assert_allclose(
        estimated[1].vertices - estimated[0].vertices,
        registered[1].vertices - registered[0].vertices + [0, 0.02, 0],
        atol=1e-9,
    )


def test_scans_have_no_truth_and_no_errors(made, tmp_path):
    shown = case(2, truth=False)
    assert len(step_cells(shown, 0, 0, Scene())) == 4
    assert step_cells(shown, 1, 1, Scene())[1] is None
    made.clear()
    plot_steps(tmp_path / "steps.png", [(shown, [0, 1])])
    assert len(made) == 7
    narrow, wide = Image.open(tmp_path / "steps.png").size[0], 7 * 250
    plot_steps(tmp_path / "steps.png", [(case(2), [0])])
    assert narrow < wide < Image.open(tmp_path / "steps.png").size[0]


def test_results_have_a_cloud_above_each_reconstruction(made, tmp_path):
    shown = case(4)
    plot_results(tmp_path / "results.png", [(shown, [0, 2, 3]), (case(2), [1])])
    assert len(made) == 2 * 3 + 2
    for index, frame in enumerate((0, 2, 3)):
        assert len(made[index]) > 2  # a cloud
        worn = made[3 + index][1].vertices
        np.testing.assert_allclose(np.ptp(worn, axis=0), np.ptp(shown.final[frame], axis=0))
    heights = [parts[0].vertices[:, 2].min() for parts in made[3:6]]
    np.testing.assert_allclose(heights, 0, atol=1e-9)  # on the floor, however tall it is


def test_animation_has_a_picture_per_frame_with_all_stages(made, tmp_path):
    for truth, panels in ((True, 4), (False, 3)):
        made.clear()
        animate_steps(tmp_path / "moving.png", case(3, truth=truth), frame_ms=50)
        assert len(made) == 3 * panels
        with Image.open(tmp_path / "moving.png") as image:
            assert image.size == (panels * 340, 480)
    assert image.size[1] > 270


def test_frames_are_spread_over_the_sequence():
    assert spread_frames(10, 2) == [2, 7]
    assert spread_frames(3, 5) == [0, 1, 2]


TUBE, FACES = 2 * tube() - [0, 0, 0.6], tube_faces(False)


def test_the_worst_place_is_where_edges_changed_most():
    posed = Rotation.from_rotvec([0.3, 1, 2]).apply(TUBE) + 5
    posed[77] += 0.2
    assert worst_place(TUBE, posed, FACES) == 77


def test_neighbours_ring_the_worst_place_beside_its_close_up(made, tmp_path):
    nearest = TUBE.copy()
    vertex = int(np.argmax(TUBE[:, 0] - np.abs(TUBE[:, 2])))
    nearest[vertex] += [0.1, 0, 0]
    twice = SkinnedTwice("a", "Skirt", TUBE, FACES, nearest, TUBE, 0.9 * TUBE, FACES, 1.0)
    plot_neighbours(tmp_path / "f7.png", [twice], 256)
    np.testing.assert_allclose(made[0][1].vertices - made[2][1].vertices, nearest - TUBE)
    sheet = np.asarray(Image.open(tmp_path / "f7.png").convert("RGB")).astype(int)
    left = sheet.shape[1] - 4 * 256
    for column in range(4):
        panel = sheet[:, left + 256 * column : left + 256 * (column + 1)]
        ring = np.argwhere((np.abs(panel - [213, 94, 0]) < 40).all(-1))
        assert (len(ring) > 40) == (column % 2 == 0)
        if column == 0:
            # The camera stands before the place, so that it is in the middle.
            assert abs(ring[:, 1].mean() - 125) < 25


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
