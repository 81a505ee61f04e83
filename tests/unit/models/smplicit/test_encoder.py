import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.smplicit.encoder import ImageEncoder, load_encoder_weights


def encoder(width=2, outputs=3):
    return ImageEncoder(outputs, width, torch.Generator().manual_seed(0))


def test_names_and_shapes_are_those_of_a_resnet_18():
    state = encoder(64, 1000).state_dict()
    assert len(state) == 122
    assert sum(value.numel() for name, value in encoder(64, 1000).named_parameters()) == 11_689_512
    assert state["layer4.1.conv2.weight"].shape == (512, 512, 3, 3)
    assert state["layer2.0.downsample.0.weight"].shape == (128, 64, 1, 1)
    assert state["fc.weight"].shape == (1000, 512)


def test_images_get_codes_near_zero_that_differ():
    images = torch.zeros(3, 32, 32, dtype=torch.bool)
    images[1, :16] = True
    images[2] = True
    codes = encoder().eval()(images)
    assert codes.shape == (3, 3)
    assert codes.abs().max() < 1
    assert not torch.allclose(codes[0], codes[1])


def test_a_file_of_weights_is_the_start_but_for_the_last_layer(tmp_path):
    known = encoder(outputs=9)
    with torch.no_grad():
        for value in known.parameters():
            value.add_(1.0)
    torch.save(known.state_dict(), tmp_path / "weights.pth")
    own = encoder()
    before = own.fc.weight.clone()
    load_encoder_weights(own, tmp_path / "weights.pth")
    assert torch.equal(own.layer3[1].conv1.weight, known.layer3[1].conv1.weight)
    assert torch.equal(own.fc.weight, before)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "weights.pth"
    with pytest.raises(InputError, match=r"weights\.pth: no such file"):
        load_encoder_weights(encoder(), path)
    path.write_text("nonsense")
    with pytest.raises(InputError, match=r"weights\.pth: not readable"):
        load_encoder_weights(encoder(), path)
    torch.save([1, 2], path)
    with pytest.raises(InputError, match="holds no weights by name"):
        load_encoder_weights(encoder(), path)
    torch.save(encoder(4).state_dict(), path)
    with pytest.raises(InputError, match=r"lacks 'bn1\.bias' of shape .* of width 2"):
        load_encoder_weights(encoder(), path)
