import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.geometry.mesh import triangulate
from drapeline.models.pictures.known import pictures_of_job, take_pictures
from drapeline.models.pictures.read import CLASSES
from toys.jobs import job_of
from toys.smplicit import toy_bodies
from toys.tiny_sample import write_tiny_sample

SETTINGS = {"count": 2, "size_px": 64}


@pytest.fixture(scope="module")
def tiny(tmp_path_factory, toy_body):
    return write_tiny_sample(tmp_path_factory.mktemp("stages"), toy_body)


@pytest.fixture(scope="module")
def pictures(tiny, toy_body):
    return take_pictures([tiny.folder], toy_bodies(toy_body), ["skirt"], **SETTINGS, seed=3)


def test_pictures_are_of_different_frames_and_sides(pictures, tiny, toy_body):
    assert [known.picture.name for known in pictures] == ["00001_001", "00001_004"]
    first, second = (known.person.camera for known in pictures)
    # From opposite sides.
    assert first.axes[0] @ second.axes[0] == pytest.approx(-1, abs=0.05)
    for known, frame in zip(pictures, (1, 4), strict=True):
        # Root-relative, as the garments' caches are.
        bodies, _ = posed_vertices(toy_body, tiny.shape, tiny.poses[frame : frame + 1])
        assert known.body.posed - known.body.posed[0] == pytest.approx(
            bodies[0] - bodies[0, 0], abs=1e-5
        )
        for name, garment in (("upper", "Tshirt"), ("skirt", "Skirt")):
            assert known.garments[name] == garment
            assert np.array_equal(known.true[name].vertices, tiny.vertices[garment][frame])
            assert np.array_equal(known.true[name].faces, triangulate(tiny.meshes[garment].faces))
            assert np.array_equal(known.rest[name].faces, known.true[name].faces)
            assert known.rest[name].vertices == pytest.approx(
                tiny.meshes[garment].vertices, abs=1e-5
            )


@pytest.mark.parametrize(
    ("count", "expected"), [(1, [0]), (2, [0, 1]), (4, [0, 0, 1, 2]), (7, [0, 0, 0, 1, 1, 2, 2])]
)
def test_pictures_are_spread_over_samples(toy_body, tmp_path, count, expected):
    samples = [
        write_tiny_sample(tmp_path / str(index), toy_body, f"0000{index}").folder
        for index in range(3)
    ]
    pictures = take_pictures(
        samples, toy_bodies(toy_body), ["skirt"], count=count, size_px=8, seed=0
    )
    assert [int(known.picture.name.split("_")[0]) for known in pictures] == expected
    assert len({known.picture.name for known in pictures}) == count


def test_the_seed_of_trainings_changes_no_picture(tiny, toy_body, tmp_path):
    def seen(seed, picture_seed):
        told = {"samples": ["00001"], "others": [], "split": "train", "pictures": 1, "size_px": 32}
        job = job_of(
            {"samples": [tiny.folder.parent]},
            tmp_path / "out",
            **{**told, "seed": seed, "picture_seed": picture_seed},
        )
        (known,) = pictures_of_job(job, toy_bodies(toy_body), ["skirt"])
        return known.picture.classes

    first = seen(1, 3)
    np.testing.assert_array_equal(first, seen(2, 3))
    assert not np.array_equal(first, seen(1, 4))


def test_only_known_garments_are_looked_for(pictures):
    for known in pictures:
        assert known.person.garments == ("skirt",)
        assert (known.picture.classes == CLASSES.index("upper")).any()


def test_bodies_fill_the_picture(pictures):
    for known in pictures:
        seen = known.picture.classes > 0
        rows, columns = np.nonzero(seen)
        longest = max(np.ptp(rows), np.ptp(columns))
        assert 0.6 * SETTINGS["size_px"] < longest < SETTINGS["size_px"] - 1
