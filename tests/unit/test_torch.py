import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch

from drapeline.dataset.info_mat import read_info, write_info
from drapeline.dataset.reader import Cloth3D
from drapeline.dataset.record import SAMPLE_MANIFEST
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.manifest import write_manifest
from drapeline.torch import FrameDataset, SeededOrder, SequenceDataset, collate, make_loader
from toys.tiny_sample import write_tiny_sample

FRAMES = {"00001": 6, "00002": 4, "00003": 9}


@pytest.fixture(scope="module")
def root(tmp_path_factory, toy_body):
    """Three samples in outfits of a t-shirt and a skirt; the second one wears the skirt alone."""
    stages = tmp_path_factory.mktemp("stages")
    for seed, (sample, frames) in enumerate(FRAMES.items()):
        write_tiny_sample(
            stages, toy_body, sample, frames=frames, seed=seed, gender=GENDERS[seed % 2]
        )
    alone = stages / "samples" / "00002" / "info.mat"
    info = read_info(alone)
    write_info(alone, replace(info, outfit={"Skirt": info.outfit["Skirt"]}, tightness=None))
    write_manifest(alone.parent, SAMPLE_MANIFEST)
    return stages / "samples"


@pytest.fixture
def data(root):
    return Cloth3D(root)


def test_a_frame_is_what_the_reader_says_of_it(data):
    frames = FrameDataset(data)
    assert len(frames) == sum(FRAMES.values())
    found = frames[FRAMES["00001"] + FRAMES["00002"] + 5]
    sample = data["00003"]
    assert (found.sample, found.frame, found.garments) == ("00003", 5, sample.garments)
    for name, vertices, faces, rest in zip(
        found.garments, found.vertices, found.faces, found.rest, strict=True
    ):
        np.testing.assert_array_equal(vertices, sample.vertices(name, 5, 6, "root")[0])
        np.testing.assert_array_equal(faces, sample.mesh(name).triangles)
        np.testing.assert_array_equal(rest, sample.mesh(name).vertices)
    np.testing.assert_array_equal(found.body, sample.body_vertices(5, 6, "root")[0])
    np.testing.assert_allclose(found.poses, sample.info.poses[5], rtol=1e-6)
    np.testing.assert_allclose(found.trans, sample.root_positions(5, 6)[0], rtol=1e-6)
    np.testing.assert_allclose(found.shape, sample.info.shape, rtol=1e-6)
    np.testing.assert_allclose(found.tightness, sample.tightness, rtol=1e-6)
    assert found.gender == GENDERS.index(sample.gender)
    assert torch.isnan(frames[FRAMES["00001"]].tightness).all()


def test_frames_can_be_in_world_coordinates_without_bodies_and_some_steps_apart(data):
    frames = FrameDataset(data, step=4, body=False, coordinates="world")
    assert [(x.sample, x.frame) for x in map(frames.__getitem__, range(len(frames)))] == [
        *(("00001", 0), ("00001", 4), ("00002", 0)),
        *(("00003", 0), ("00003", 4), ("00003", 8)),
    ]
    assert frames[1].body is None
    np.testing.assert_array_equal(
        frames[1].vertices[1], data["00001"].vertices(frames[1].garments[1], 4, 5)[0]
    )


def test_windows_cover_the_samples_that_are_long_enough(data):
    windows = SequenceDataset(data, 5, stride=3)
    assert [(x.sample, x.frame) for x in map(windows.__getitem__, range(len(windows)))] == [
        *(("00001", 0), ("00001", 1)),
        *(("00003", 0), ("00003", 3), ("00003", 4)),
    ]
    last = windows[4]
    sample = data["00003"]
    np.testing.assert_array_equal(last.vertices[0], sample.vertices(last.garments[0], 4, 9, "root"))
    np.testing.assert_array_equal(last.body, sample.body_vertices(4, 9, "root"))
    assert last.poses.shape == (5, 72)
    with pytest.raises(InputError, match="no sample wears any garment in 10 or more frames"):
        SequenceDataset(data, 10)
    with pytest.raises(InputError, match="windows of 5 frames have a stride of 6"):
        SequenceDataset(data, 5, stride=6)


def test_only_garments_that_are_asked_for_are_read(data):
    shirts = FrameDataset(data, garments=["Tshirt"])
    assert {shirts[index].sample for index in range(len(shirts))} == {"00001", "00003"}
    assert shirts[0].garments == ("Tshirt",)
    with pytest.raises(InputError, match="no sample wears Dress or Top in 1 or more frames"):
        FrameDataset(data, garments=["Dress", "Top"])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda data: FrameDataset(data, step=0), "step is 0, expected at least 1"),
        (lambda data: FrameDataset(data, step=-1), "step is -1, expected at least 1"),
        (lambda data: FrameDataset(data, keep=0), "keep is 0, expected at least 1"),
        (lambda data: SequenceDataset(data, 0), "frames is 0, expected at least 1"),
        (lambda data: FrameDataset(data, garments="Skirt"), r"expected a list, such as .'Skirt'."),
    ],
)
def test_arguments_without_a_sense_are_refused(data, make, message):
    with pytest.raises(InputError, match=message):
        make(data)


def test_threads_read_what_one_reads_though_few_samples_stay_open(data):
    frames = FrameDataset(data, keep=1)
    order = [*range(len(frames))] * 5
    with ThreadPoolExecutor(6) as pool:
        read = list(pool.map(frames.__getitem__, order))
    for index, item in zip(order, read, strict=True):
        for one, other in zip(item.vertices, frames[index].vertices, strict=True):
            assert torch.equal(one, other)


def test_a_batch_has_bodies_in_all_items_or_in_none(data):
    item = FrameDataset(data)[0]
    assert collate([item._replace(body=None)] * 2).body is None
    with pytest.raises(InputError, match="bodies in 1 of 2 items, expected all or none"):
        collate([item._replace(body=torch.zeros(4, 3)), item._replace(body=None)])


@pytest.mark.parametrize("frames", [None, 3])
def test_meshes_of_any_size_are_packed_and_unpacked(data, frames):
    read = FrameDataset(data) if frames is None else SequenceDataset(data, frames)
    items = [read[index] for index in (0, len(read) - 1, 6 if frames is None else 2)]
    batch = collate(items)
    assert batch.sample == [item.sample for item in items]
    assert batch.garment == [name for item in items for name in item.garments]
    assert batch.item.tolist() == [0, 0, 1, 1, 2]
    vertices = [x for item in items for x in item.vertices]
    assert len({x.shape[-2] for x in vertices}) > 1
    for mesh, packed in enumerate(batch.unpack(batch.vertices)):
        torch.testing.assert_close(packed, vertices[mesh], rtol=0, atol=0)
        torch.testing.assert_close(
            batch.vertices[..., batch.mesh == mesh, :], vertices[mesh], rtol=0, atol=0
        )
    faces = [x for item in items for x in item.faces]
    for mesh, own in enumerate(batch.faces.split(batch.face_count.tolist())):
        assert (batch.mesh[own] == mesh).all()
        torch.testing.assert_close(
            batch.vertices[..., own, :], vertices[mesh][..., faces[mesh], :], rtol=0, atol=0
        )
    assert batch.rest.shape == (len(batch.mesh), 3)
    time = () if frames is None else (frames,)
    assert batch.body.shape == (3, *time, len(data["00001"].body_mesh().vertices), 3)
    assert batch.poses.shape == (3, *time, 72)
    assert batch.to("cpu").frame.tolist() == [item.frame for item in items]


def test_the_order_depends_on_seed_and_epoch_alone(data):
    def order(loader):
        return [(name, int(n)) for batch in loader for name, n in zip(*batch[:2], strict=True)]

    frames = FrameDataset(data, body=False)
    loader = make_loader(frames, 4, seed=3)
    first, second = order(loader), order(loader)
    assert sorted(first) == sorted(second) == order(make_loader(frames, 4))
    assert first != second
    assert first == order(make_loader(frames, 7, seed=3)) != order(make_loader(frames, 4, seed=4))
    resumed = make_loader(frames, 4, seed=3)
    assert isinstance(resumed.sampler, SeededOrder)
    resumed.sampler.epoch = 1
    assert order(resumed) == second


def test_workers_bring_the_same_batches(data):
    frames = FrameDataset(data)
    plain, working = (make_loader(frames, 8, seed=0, workers=workers) for workers in (0, 2))
    for one, other in zip(plain, working, strict=True):
        assert one.sample == other.sample
        torch.testing.assert_close(one.vertices, other.vertices, rtol=0, atol=0)


def test_few_samples_stay_open_and_others_are_closed(data):
    frames = FrameDataset(data, keep=1)
    opened = frames._kept["00001"].sample
    assert opened._caches == {}
    assert frames[0].sample == "00001"
    assert opened._caches
    assert frames[len(frames) - 1].sample == "00003"
    assert not opened._caches
    again = pickle.loads(pickle.dumps(frames))
    assert not again._kept._open
    torch.testing.assert_close(again[0].vertices[0], frames[0].vertices[0])
