"""Scans of simulated samples with the bodies that fit them."""

from drapeline.bodies.settings import BodyFit
from drapeline.dataset.scan_bodies import scan_samples
from drapeline.dataset.segmented_scans import load_scans
from drapeline.dataset.settings import ScanSettings
from toys.tiny_sample import write_tiny_sample


def test_accepted_samples_are_scanned_and_rejected_ones_are_not(tmp_path, toy_body):
    samples = [
        write_tiny_sample(tmp_path / name, toy_body, name, status=status).folder
        for name, status in (("00001", "rejected"), ("00002", "accepted"), ("00003", "accepted"))
    ]
    scan_samples(
        tmp_path / "scans.npz",
        samples,
        {"female": toy_body, "male": toy_body},
        settings=ScanSettings(frames=1, points=300),
        fit=BodyFit(steps=1, joint_steps=1, points=100),
        seed=0,
    )
    scans = load_scans(tmp_path / "scans.npz")
    assert [scan.name.split("_")[0] for scan, _ in scans] == ["00002", "00003"]
