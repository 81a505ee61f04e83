import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import load_fitted_scans, save_fitted_scans
from drapeline.metrics.properties import CLASSES, scan_class


@pytest.mark.parametrize(
    ("region", "properties", "expected"),
    [
        ("upper", {"sleeve": 0.2}, "short upper"),
        ("upper", {"sleeve": 0.9}, "long upper"),
        ("lower", {"leg": 0.4}, "short lower"),
        ("lower", {"leg": 1.0}, "long lower"),
        ("whole", {"sleeve": 0.0, "leg": 1.0}, "whole body"),
    ],
)
def test_classes_go_by_limbs(region, properties, expected):
    assert scan_class(region, properties) == expected
    assert expected in CLASSES


def test_files_keep_fits(tmp_path):
    mesh = Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))
    none = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    found = {"00001_015": {"ours": {"Skirt": mesh, "Top": none}, "theirs": {"Skirt": mesh}}}
    save_fitted_scans(tmp_path / "fits.npz", found)
    again = load_fitted_scans(tmp_path / "fits.npz")
    assert {k: {v: set(g) for v, g in f.items()} for k, f in again.items()} == {
        "00001_015": {"ours": {"Skirt", "Top"}, "theirs": {"Skirt"}}
    }
    np.testing.assert_array_equal(again["00001_015"]["ours"]["Skirt"].vertices, mesh.vertices)
    assert len(again["00001_015"]["ours"]["Top"].faces) == 0


def test_a_name_that_is_none_of_a_fit_is_refused(tmp_path):
    np.savez(tmp_path / "fits.npz", keys=np.array(["00001_015"]))
    with pytest.raises(InputError, match=r"fits\.npz: names a fit '00001_015', expected scan/"):
        load_fitted_scans(tmp_path / "fits.npz")
