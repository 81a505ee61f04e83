"""The page and the sheets of fits to scans."""

import numpy as np
from PIL import Image

from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.labels import LABELS
from drapeline.dataset.segmented_scans import SegmentedScan, save_scans
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.fitted_scans import BODY, TRUE, save_fitted_scans
from drapeline.metrics.table import HIGH, LOW, write_metrics
from drapeline.report.models.scans import OWN, plot_own_scans, plot_scans, write_scans_page
from toys.metric_rows import metric_row
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


def row(variant, garment, value, metric="surface_to_true_mm", source=""):
    return metric_row(variant, garment, metric, value, model="scan", split="test", source=source)


def test_fits_have_a_row_each_and_the_papers_figures_a_table_of_their_own(tmp_path):
    rows = [
        row("smplicit_scan_joint", "all", 12.34),
        row("smplicit_scan_joint", "long lower", 21.0),
        row("smplicit_scan_joint", "long lower", 20.0, "surface_to_true_mm" + LOW),
        row("smplicit_scan_joint", "long lower", 22.0, "surface_to_true_mm" + HIGH),
        row("svae_scan", "all", 56.78),
        row("svae_scan", "all", 43.21, "true_to_surface_mm"),
        row("scan_body_fitted", "all", 3.4, "vertex_error_mm"),
    ]
    write_metrics(tmp_path / "metrics.tsv", rows)
    write_scans_page(tmp_path / "page.html", tmp_path / "metrics.tsv")
    page = (tmp_path / "page.html").read_text()
    ours, back, bodies, paper = page.split("<table")[1:]
    assert "12.3" in ours
    assert "21.0 (20.0 to 22.0)" in ours
    assert "short upper" not in ours
    assert "3.4" in bodies
    assert "TailorNet" in paper
    assert "0.32" in paper
    assert "0.32" not in ours + back
    assert "43.2" in back
    assert ours.count("<tr") == 3


def test_garments_of_several_solvers_have_tables_of_their_own(tmp_path):
    values = {"": 12.34, "blender": 56.78, "xpbd": 9.87}
    rows = [row("smplicit_scan_joint", "all", value, source=name) for name, value in values.items()]
    write_metrics(tmp_path / "metrics.tsv", rows)
    write_scans_page(tmp_path / "page.html", tmp_path / "metrics.tsv")
    every, blender, xpbd, *_ = (tmp_path / "page.html").read_text().split("<table")[1:]
    assert "12.3" in every
    assert "samples of blender alone" in every
    assert "56.8" in blender
    assert "9.9" in xpbd


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
