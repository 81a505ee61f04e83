import numpy as np
import pytest

from drapeline.bodies.follow import PosedBody
from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.frames import REST_POSE
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import Mesh
from drapeline.outfits.garment_types import LABELS
from drapeline.registration.to_scan import move_to_scan
from toys.smplicit import tube

CORE = tube(0.15, -0.5, 0.5, around=64, rings=41)
STATE = BodyState.of(REST_POSE, np.zeros(3), np.zeros(10))


def body():
    turns = np.repeat(np.eye(3)[None], len(CORE.vertices), axis=0)
    rest = CORE.vertices.astype(float)
    return PosedBody(rest, rest, turns, CORE.faces)


def scan(**clouds):
    labels = np.repeat([LABELS.index(name) for name in clouds], [len(c) for c in clouds.values()])
    points = np.concatenate([*clouds.values()]).astype(np.float32)
    garments = tuple(name for name in clouds if name != "Body")
    return SegmentedScan("s", 0, points, labels.astype(np.uint8), garments, "male", STATE, None)


@pytest.mark.portable
def test_garments_come_to_lie_on_their_own_points():
    found = tube(0.25, -0.3, 0.2, around=48, rings=15)
    true = tube(0.25, -0.3, 0.2, around=90, rings=40).vertices + [0.03, 0, 0]
    shown = scan(Body=CORE.vertices, Skirt=true)
    (moved,) = move_to_scan({"Skirt": found}, {"Skirt": found}, shown, body()).values()
    before, after = (
        np.linalg.norm(closest_points(true, mesh.vertices, mesh.faces)[0] - true, axis=1).mean()
        for mesh in (found, moved)
    )
    assert before > 0.01
    assert after < before / 4
    np.testing.assert_array_equal(moved.faces, found.faces)


def test_garments_without_faces_or_points_stay():
    none = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    found = tube(0.25, -0.3, 0.2)
    shown = scan(Body=CORE.vertices, Top=found.vertices)
    posed = {"Top": none, "Skirt": found}
    moved = move_to_scan(posed, posed, shown, body())
    assert len(moved["Top"].faces) == 0
    np.testing.assert_allclose(moved["Skirt"].vertices, found.vertices, atol=1e-6)
