"""Settings of simulations."""

from drapeline.settings import Field, Settings


class SimulationSettings(Settings):
    """Simulation of cloth."""

    steps_min: int = Field(
        14, ge=1, le=80, description="Solver steps per frame for the simplest outfits."
    )
    steps_max: int = Field(
        14, ge=1, le=80, description="Solver steps per frame for the most complex outfits."
    )
    shape_frames: int = Field(
        4,
        ge=1,
        le=300,
        description=(
            "Frames for the transition from the shape that garments are made for to the sample's."
        ),
    )
    pose_frames: int = Field(
        8,
        ge=1,
        le=300,
        description=(
            "Frames for the transition from the rest pose, turned as the sequence begins, to the "
            "first pose."
        ),
    )
    settle_frames: int = Field(
        8,
        ge=0,
        le=300,
        description=(
            "Frames in which the body then stands still, so that the cloth comes to rest before "
            "the sequence begins."
        ),
    )
    gap_m: float = Field(
        0.004, ge=0.001, le=0.03, description="Distance between cloth and body in metres."
    )
    collider_share: float = Field(
        0.6,
        ge=0.1,
        le=1.0,
        description=(
            "Share of the body's triangles that cloth collides with in the first attempt; later "
            "attempts use all. Fewer are slightly faster and hardly less accurate."
        ),
    )
    floor: bool = Field(
        True,
        description=(
            "Whether cloth lies on the floor, at the height of the clip's lowest points. Without "
            "it, the clothes of somebody who crawls hang through the ground."
        ),
    )
    attempts: int = Field(
        2,
        ge=1,
        le=5,
        description="Attempts, each finer than the last, before a sample is rejected.",
    )


class HealthBounds(Settings):
    """Bounds that a sample must keep to be accepted."""

    inside_open_mean: float = Field(
        0.006,
        ge=0,
        le=1,
        description=(
            "Share of garment vertices inside the body, mean over frames; those in its folds, "
            "where the body faces itself within 40 mm or overlaps itself, do not count."
        ),
    )
    inside_open_max: float = Field(0.05, ge=0, le=1, description="The same, in the worst frame.")
    depth_m: float = Field(
        0.025,
        ge=0,
        le=1,
        description=(
            "Deepest vertex inside the body, 95th percentile over frames, in metres; those in its "
            "folds do not count."
        ),
    )
    stretch_low: float = Field(
        0.7,
        ge=0,
        le=1,
        description=(
            "Edge length divided by rest length, 1st percentile, mean over frames. Threads that "
            "are pushed buckle, between the vertices of a mesh too."
        ),
    )
    stretch_high: float = Field(1.25, ge=1, le=10, description="The same, 99th percentile.")
    slip_m: float = Field(
        0.3, ge=0, le=2, description="How far a garment may slide along the body, in metres."
    )
    lost_openings: float = Field(
        0.25,
        ge=0,
        le=10,
        description=(
            "Openings that a limb passed at rest and none passes any more, as of a garment that "
            "fell off, mean number over frames; hems of skirts do not count."
        ),
    )
    layer_share_mean: float = Field(
        0.05,
        ge=0,
        le=1,
        description=(
            "Share of the outer garment's vertices beneath the inner garment, mean over frames."
        ),
    )
    self_share_mean: float = Field(
        0.1,
        ge=0,
        le=1,
        description="Share of edges that pass through the garment's own faces, mean over frames.",
    )
