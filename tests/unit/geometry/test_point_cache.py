import pickle
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drapeline.errors import InputError
from drapeline.geometry.point_cache import (
    SUFFIXES,
    PointCache,
    half_to_single,
    point_cache_writer,
    write_point_cache,
)


@pytest.fixture
def frames():
    return np.random.default_rng(0).uniform(-2, 2, (7, 11, 3)).astype(np.float32)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_frames_come_back_whatever_way_they_were_appended(tmp_path, frames, suffix):
    path = tmp_path / f"a{suffix}"
    with point_cache_writer(path, 11, frame_count=7) as writer:
        writer.append(frames[0])
        writer.append(frames[1:4])
        for frame in frames[4:].astype(np.float64):
            writer.append(frame)
    expected = frames.astype(np.float16) if suffix == ".pc16" else frames
    with PointCache(path, 11) as cache:
        assert (len(cache), cache.vertex_count) == (7, 11)
        assert cache.frames().dtype == np.float32
        np.testing.assert_array_equal(cache.frames(), expected)
        np.testing.assert_array_equal(cache.frames(2, 5), expected[2:5])
        assert cache.frames(7, 7).shape == (0, 11, 3)


def test_pc16_is_the_cloth3d_layout_byte_by_byte(tmp_path):
    frames = np.arange(18, dtype=np.float32).reshape(2, 3, 3)
    write_point_cache(tmp_path / "a.pc16", frames)
    header = b"POINTCACHE2\0" + struct.pack("<iiffi", 1, 3, 0.0, 1.0, 2)
    body = b"".join(struct.pack("<e", value) for value in range(18))
    assert (tmp_path / "a.pc16").read_bytes() == header + body


def test_mdd_is_big_endian_with_a_time_per_frame(tmp_path):
    write_point_cache(tmp_path / "a.mdd", np.arange(18, dtype=np.float32).reshape(2, 3, 3))
    expected = struct.pack(">ii2f18f", 2, 3, 0.0, 1 / 30, *range(18))
    assert (tmp_path / "a.mdd").read_bytes() == expected


def test_an_iterator_of_frames_may_have_any_length(tmp_path, frames):
    assert write_point_cache(tmp_path / "a.pc2", iter(frames)) == 7
    np.testing.assert_array_equal(PointCache(tmp_path / "a.pc2").frames(), frames)


def test_nothing_is_left_of_a_cache_whose_making_failed(tmp_path, frames):
    with pytest.raises(RuntimeError), point_cache_writer(tmp_path / "a.pc2", 11) as writer:
        writer.append(frames)
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_number_of_frames_is_not_written(tmp_path, frames):
    with (
        pytest.raises(ValueError, match="7 frames written, not 8"),
        point_cache_writer(tmp_path / "a.mdd", 11, frame_count=8) as writer,
    ):
        writer.append(frames)
    assert list(tmp_path.iterdir()) == []


def test_frames_of_another_shape_are_refused(tmp_path, frames):
    with pytest.raises(ValueError, match=r"expected \(N, 12, 3\)"):
        write_point_cache(tmp_path / "a.pc2", [np.zeros((12, 3)), frames[0]])


@pytest.mark.parametrize(("start", "stop"), [(-1, 2), (0, 8), (5, 4)])
def test_frames_outside_of_the_file_are_an_index_error(tmp_path, frames, start, stop):
    write_point_cache(tmp_path / "a.pc2", frames)
    with pytest.raises(IndexError, match=r"within \[0, 7\)"):
        PointCache(tmp_path / "a.pc2").frames(start, stop)


@pytest.mark.parametrize("suffix", [".pc2", ".pc16", ".mdd"])
@pytest.mark.parametrize("change", [-1, 6, -600])
def test_a_truncated_or_overlong_file_is_refused_with_both_sizes(tmp_path, frames, suffix, change):
    path = tmp_path / f"a{suffix}"
    write_point_cache(path, frames)
    data = path.read_bytes()
    broken = data[:change] if change < 0 else data + bytes(change)
    path.write_bytes(broken)
    with pytest.raises(InputError) as caught:
        PointCache(path)
    assert str(path) in str(caught.value)
    assert f"{len(broken)} bytes, expected" in str(caught.value)
    if len(broken) >= 32:
        assert f"expected {len(data)} for 7 frames of 11 vertices" in str(caught.value)


def test_a_headerless_file_must_hold_whole_frames(tmp_path, frames):
    write_point_cache(tmp_path / "a.f32", frames)
    with pytest.raises(InputError, match="924 bytes, expected 840 for 7 frames of 10 vertices"):
        PointCache(tmp_path / "a.f32", 10)


@pytest.mark.parametrize(
    ("header", "complaint"),
    [
        (b"POINTCACHE3\0" + struct.pack("<iiffi", 1, 3, 0, 1, 2), "expected b'POINTCACHE2"),
        (b"POINTCACHE2\0" + struct.pack("<iiffi", 2, 3, 0, 1, 2), "version 2"),
        (b"POINTCACHE2\0" + struct.pack("<iiffi", 1, -3, 0, 1, 2), "-3 vertices"),
    ],
)
def test_another_format_is_refused(tmp_path, header, complaint):
    (tmp_path / "a.pc16").write_bytes(header)
    with pytest.raises(InputError, match=complaint):
        PointCache(tmp_path / "a.pc16")


def test_another_vertex_count_than_the_meshs_is_refused(tmp_path, frames):
    write_point_cache(tmp_path / "a.pc16", frames)
    with pytest.raises(InputError, match="11 vertices per frame, expected 12"):
        PointCache(tmp_path / "a.pc16", 12)


def test_missing_files_and_unknown_suffixes_are_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        PointCache(tmp_path / "a.pc2")
    with pytest.raises(InputError, match="suffix '.abc', expected one of .pc2"):
        PointCache(tmp_path / "a.abc")


def test_a_cache_can_be_sent_to_another_process(tmp_path, frames):
    write_point_cache(tmp_path / "a.f32", frames)
    with PointCache(tmp_path / "a.f32", 11) as cache, pickle.loads(pickle.dumps(cache)) as copy:
        np.testing.assert_array_equal(copy.frames(), frames)


def test_every_half_precision_number_becomes_the_same_single_precision_number():
    bits = np.arange(65536, dtype=np.uint16)
    finite = bits[np.isfinite(bits.view(np.float16))]
    for part in (bits, finite):
        np.testing.assert_array_equal(half_to_single(part), part.view(np.float16).astype("f4"))
    assert np.signbit(half_to_single(np.array([0x8000], dtype=np.uint16)))[0]


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 5), st.integers(1, 6), st.sampled_from(SUFFIXES), st.integers(0, 99))
def test_any_range_equals_the_slice_of_the_whole(tmp_path_factory, count, vertices, suffix, seed):
    path = tmp_path_factory.mktemp("cache") / f"a{suffix}"
    rng = np.random.default_rng(seed)
    write_point_cache(path, rng.normal(size=(count, vertices, 3)))
    start, stop = sorted(rng.integers(0, count + 1, 2))
    with PointCache(path, vertices) as cache:
        np.testing.assert_array_equal(cache.frames(start, stop), cache.frames()[start:stop])


def test_more_caches_are_open_than_a_process_has_handles(tmp_path, frames):
    path = tmp_path / "a.pc2"
    write_point_cache(path, frames)
    resource = pytest.importorskip("resource")
    most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(most[0], 1024), most[1]))
    try:
        caches = [PointCache(path) for _ in range(2000)]
        for cache in caches:
            np.testing.assert_array_equal(cache.frames(3, 4), frames[3:4])
            cache.close()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, most)
