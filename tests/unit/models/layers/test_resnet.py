import torch

from drapeline.models.layers.resnet import ResNet18


def test_images_of_any_channels_give_as_many_numbers_as_asked_for():
    for channels in (1, 7):
        network = ResNet18(channels, 5, 2, torch.Generator().manual_seed(0)).eval()
        images = torch.rand(3, channels, 40, 32, generator=torch.Generator().manual_seed(1))
        numbers = network(images)
        assert numbers.shape == (3, 5)
        # Every channel counts.
        for channel in range(channels):
            changed = images.clone()
            changed[:, channel] += 1
            assert not torch.allclose(network(changed), numbers)
