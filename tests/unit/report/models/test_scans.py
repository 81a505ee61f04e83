"""The sheets of fits to scans."""

import numpy as np
from PIL import Image

from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.segmented_scans import SegmentedScan, save_scans
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import BODY, TRUE, save_fitted_scans
from drapeline.outfits.garment_types import LABELS
from drapeline.report.models.scans import OWN, plot_own_scans, plot_scans
from toys.smplicit import tube

STATE = BodyState.of(REST_POSE, np.zeros(3), np.zeros(10))
MAN, CLOTH = tube(0.15, -0.9, 0.7), tube(0.2, -0.4, 0.1)


def scan(name="00007_015"):
    clouds = {"Body": MAN.vertices, "Skirt": CLOTH.vertices}
    labels = np.repeat([LABELS.index(one) for one in clouds], [len(c) for c in clouds.values()])
    points = np.concatenate([*clouds.values()])
    return SegmentedScan(
        name, 15, points, labels.astype(np.uint8), ("Skirt",), "female", STATE, None
    )


def test_a_sheet_has_a_row_for_each_scan_and_no_more_than_asked(tmp_path):
    scans = [scan(f"00007_{frame:03d}") for frame in (15, 45)]
    save_scans(tmp_path / "scans.npz", scans, [STATE, STATE])
    shown = {TRUE: {"Skirt": CLOTH}, BODY: {BODY: MAN}}
    fits = {one.name: {"smplicit_scan_joint": {"Skirt": CLOTH}, **shown} for one in scans}
    save_fitted_scans(tmp_path / "smplicit.npz", fits)
    save_fitted_scans(tmp_path / "gcvae.npz", {scans[0].name: {"svae_scan": {"Skirt": CLOTH}}})
    files = [tmp_path / "smplicit.npz", tmp_path / "gcvae.npz"]
    for most in (1, 2):
        plot_scans(tmp_path / f"{most}.png", [tmp_path / "scans.npz"], files, most)
    one, two = (Image.open(tmp_path / f"{most}.png").size for most in (1, 2))
    assert two[0] == one[0]
    assert two[1] > one[1] + 200


def test_what_has_a_body_of_its_own_is_shown_on_it(tmp_path):
    save_scans(tmp_path / "scans.npz", [scan("00007_015")], [STATE])
    sizes = []
    for name, own in (("common", {}), ("own", {BODY: Mesh(1.3 * MAN.vertices, MAN.faces)})):
        fits = {"smplicit_scan_joint": {"Skirt": CLOTH, **own}, BODY: {BODY: MAN}}
        save_fitted_scans(tmp_path / f"{name}.npz", {"00007_015": fits})
        plot_scans(
            tmp_path / f"{name}.png", [tmp_path / "scans.npz"], [tmp_path / f"{name}.npz"], 1
        )
        image = np.asarray(Image.open(tmp_path / f"{name}.png").convert("L"))
        sizes.append((image[:, image.shape[1] // 2 :] < 240).sum())
    assert sizes[1] > 1.2 * sizes[0]


def test_without_scans_a_card_says_so(tmp_path):
    save_scans(tmp_path / "scans.npz", [], [])
    save_fitted_scans(tmp_path / "fits.npz", {})
    plot_scans(tmp_path / "none.png", [tmp_path / "scans.npz"], [tmp_path / "fits.npz"], 3)
    assert np.asarray(Image.open(tmp_path / "none.png")).std() > 1


def test_a_users_scans_are_shown_with_what_was_found(tmp_path):
    plot_own_scans(tmp_path / "own.png", [(scan(), {BODY: {BODY: MAN}, OWN: {"Skirt": CLOTH}})])
    picture = np.asarray(Image.open(tmp_path / "own.png").convert("RGB"))
    assert (np.ptp(picture, axis=2) > 40).any()
