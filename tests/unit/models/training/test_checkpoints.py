import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.training.checkpoints import read_checkpoint


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "no such file"), (b"not weights", "not readable as a checkpoint"), ({}, "drapeline")],
)
def test_what_is_no_checkpoint_of_ours_is_refused(tmp_path, content, message):
    path = tmp_path / "best.ckpt"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        torch.save(content, path)
    with pytest.raises(InputError, match=rf"best\.ckpt.*{message}"):
        read_checkpoint(path)
