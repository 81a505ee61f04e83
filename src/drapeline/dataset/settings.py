"""Settings of point clouds and of scans."""

from typing import Literal

from drapeline.settings import Field, Settings, SkipJsonSchema

Visibility = Literal["all", "multi", "single"]
Protocol = Literal["surface", "vertices"]
# Ways in which held-out samples are scanned, keys of the settings `scans`.
SCAN_KINDS = NOISY, CLEAN, WORSE = "noisy", "clean", "worse"


class CloudSettings(Settings):
    """Sampling of point clouds.

    With the protocol "vertices", as in Garment4D's released code, half of the points are garment
    vertices and half are body vertices, the same ones in every frame, covered or not; `visibility`
    and `missing` do not apply then.
    """

    points: int = Field(1024, ge=10, le=10_000_000, description="Points per cloud.")
    noise_m: float = Field(
        0,
        ge=0,
        le=0.1,
        description="Standard deviation of the noise on each coordinate, in metres.",
    )
    missing: float = Field(
        0, ge=0, le=0.95, description="Share of the visible surface that lies in holes."
    )
    visibility: Visibility = Field("all", description="Cameras all around, four in a ring, or one.")
    protocol: SkipJsonSchema[Protocol] = Field("surface", description="Where points come from.")
    seed: SkipJsonSchema[int] = Field(
        0, description="With the name of a sequence and the number of a frame, it tells the points."
    )


class ScanSettings(Settings):
    """Scans of samples, and errors of the estimates of their bodies.

    A body is known where none of its errors is more than zero.
    """

    frames: int = Field(
        1, ge=1, le=300, description="Scans of each sample, evenly spread over its frames."
    )
    window: int = Field(
        1,
        ge=1,
        le=299,
        description=(
            "Frames that are scanned together, as many before the one to be measured as after it, "
            "so that an even number is one more; models of single frames see that one alone."
        ),
    )
    points: int = Field(20_000, ge=100, le=10_000_000, description="Points of a scan.")
    visibility: Visibility = Field(
        "all", description="Cameras: everything seen from around, four at the sides, or one."
    )
    missing: float = Field(0, ge=0, le=0.9, description="Share of the points that holes take away.")
    noise_m: float = Field(
        0.002,
        ge=0,
        le=0.1,
        description="Standard deviation of each coordinate of a point, in metres.",
    )
    pose_rad: float = Field(
        0.06,
        ge=0,
        le=1,
        description=(
            "Standard deviation of each joint's rotation about each axis in the estimate that "
            "fits begin with."
        ),
    )
    place_m: float = Field(
        0.03,
        ge=0,
        le=1,
        description="Standard deviation of each coordinate of the estimated root joint, in metres.",
    )
    joints_m: float = Field(
        0.02,
        ge=0,
        le=1,
        description="Standard deviation of each coordinate of predicted joints, in metres.",
    )
    shape: float | None = Field(
        None,
        ge=0,
        le=3,
        description=(
            "Standard deviation of each estimated shape coefficient; null estimates the mean shape."
        ),
    )

    @property
    def body_is_known(self) -> bool:
        """Whether the estimate is the body itself."""
        return not any((self.pose_rad, self.place_m, self.joints_m, self.shape is None, self.shape))


class OwnScans(Settings):
    """The user's scans of a dressed person."""

    points: str | None = Field(
        None, description="Your scans, a folder with one .ply per frame, or one .npz."
    )
    body: str | None = Field(
        None, description="An .npz with poses, trans, shape and gender of the body in the scans."
    )
    up: Literal["z", "y"] = Field("z", description="Axis that points up in both files.")
    fps: int = Field(
        30,
        ge=30,
        le=960,
        multiple_of=30,
        description="Frames per second of both files, a multiple of 30; they are reduced to 30.",
    )
