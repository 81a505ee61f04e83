import numpy as np

from drapeline.models.training import checkpoints
from drapeline.models.training.checkpoints import arrays_digest


def test_a_digest_tells_names_shapes_types_and_contents_apart(monkeypatch):
    array = np.arange(12, dtype=np.int32).reshape(4, 3)
    others = [
        {"b": array},
        {"a": array.reshape(3, 4)},
        {"a": array.astype(np.uint32)},
        {"a": array + np.eye(4, 3, dtype=np.int32)},
        {"a": array, "b": array},
    ]
    found = {arrays_digest(arrays) for arrays in ({"a": array}, *others)}
    assert len(found) == 1 + len(others)
    assert arrays_digest({"b": array, "a": array}) == arrays_digest({"a": array, "b": array})
    strided = np.stack([array, array])[:, ::2]
    assert arrays_digest({"a": strided}) == arrays_digest({"a": strided.copy()})
    # A large array: every second row.
    monkeypatch.setattr(checkpoints, "_DIGESTED_BYTES", array.nbytes // 2)
    for row, same in ((1, True), (2, False)):
        changed = array.copy()
        changed[row] += 1
        assert (arrays_digest({"a": changed}) == arrays_digest({"a": array})) is same
