"""Settings of static outfits that are put into motion."""

from drapeline.dataset.settings import CloudSettings
from drapeline.settings import Field, Settings, SkipJsonSchema


class SkinnedSettings(Settings):
    """Motion of static outfits; the seed of their clouds chooses the motions."""

    frames: int = Field(4, ge=1, le=300, description="Frames per outfit.")
    step: int = Field(
        3, ge=1, le=100, description="Step between these frames, in frames of the motion."
    )
    clouds: SkipJsonSchema[CloudSettings] = CloudSettings()
