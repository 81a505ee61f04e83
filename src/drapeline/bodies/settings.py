"""Settings of bodies that are fitted to scans."""

from drapeline.settings import Field, Settings


class BodyFit(Settings):
    """Fit of a body to a scan of a single frame (SMPLicit 4.2)."""

    joint_steps: int = Field(
        5, ge=0, le=1000, description="Steps of least squares for joints and priors alone."
    )
    steps: int = Field(10, ge=0, le=1000, description="Steps for all terms.")
    points: int = Field(
        1500,
        ge=10,
        le=1_000_000,
        description="Points of skin and of cloth, and vertices of the body, that count.",
    )
    weight: float = Field(
        200,
        ge=0,
        le=1_000_000,
        description="Weight of the skin, as a number of independent points.",
    )
    skin_m: float = Field(
        0.005, gt=0, le=1, description="How far points of the skin are from the body, in metres."
    )
    joints_m: float = Field(
        0.03, gt=0, le=1, description="How far predicted joints are from the body's, in metres."
    )
    pose_rad: float = Field(
        0.15, gt=0, le=10, description="How far rotations of joints are from the first estimate."
    )
    shape: float = Field(
        1.5, gt=0, le=100, description="Standard deviation of the numbers of a shape."
    )
