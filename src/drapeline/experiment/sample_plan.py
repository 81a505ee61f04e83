"""Plan of a sample."""

from dataclasses import dataclass

from drapeline.motions.variation import piece_frames
from drapeline.outfits.garment_types import removable_limbs


@dataclass(frozen=True)
class SamplePlan:
    """Plan of a sample."""

    sample: str  # its id: the prefix of its group, and five digits
    gender: str  # "female" or "male"
    outfit_type: str  # garments from inner to outer, joined by "+"
    split: str = ""  # "train", "val" or "test"; empty where it does not matter
    sequence: str = ""  # motion clip it is cut from; empty at rest
    part: int = 0  # number k of the sub-sequence ``{sequence}_s{k}``
    # start, stop: its frames in the clip at 30 fps.
    start: int = 0
    stop: int = 0
    speed: float = 1.0  # seconds of the clip per second of the sample
    mirrored: bool = False  # whether left and right are exchanged

    @property
    def frames(self) -> int:
        """Frames of the sample; none at rest."""
        return piece_frames(self.stop - self.start, self.speed) if self.sequence else 0

    @property
    def sub_sequence(self) -> str:
        """CLOTH3D's name of the piece, such as ``walk_s0``."""
        return f"{self.sequence}_s{self.part}"

    @property
    def removable(self) -> str:
        """Limbs that the outfit certainly leaves bare, a key of `bodies.animation.REMOVABLE`."""
        return removable_limbs(self.outfit_type.split("+"))
