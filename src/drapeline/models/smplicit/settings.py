"""Settings of SMPLicit."""

from typing import Annotated, Literal

from drapeline.dataset.settings import OwnScans
from drapeline.models.smplicit.garments import FIELD_MODELS
from drapeline.models.training.settings import EpochTraining, Trainer
from drapeline.outfits.garment_types import GARMENTS
from drapeline.settings import ConfigDict, EachOnce, Field, OneOf, Settings

_Weight = Annotated[float, Field(ge=0, le=1000)]
_RateShare = Annotated[float, Field(ge=0, le=10_000)]
_Model = Annotated[str, OneOf(tuple(FIELD_MODELS))]


class FieldNetwork(Settings):
    """Sizes of the decoder and of the image encoder; the decoder's are the released ones."""

    cut: int = Field(6, ge=1, le=512, description="Numbers of z_cut.")
    style: int = Field(12, ge=1, le=512, description="Numbers of z_style.")
    width: float = Field(
        1, gt=0, le=8, description="Factor on the sizes of the decoder's hidden layers."
    )
    encoder_width: int = Field(
        16,
        ge=1,
        le=512,
        description="Channels of the first stage of the image encoder; 64 makes it a ResNet-18.",
    )
    encoder_weights: str = Field(
        "",
        description=(
            "File with weights of torchvision's ResNet-18 that the image encoder starts from; "
            "without one it starts from random weights."
        ),
    )


class FieldLoss(Settings):
    """Losses of SMPLicit 3.3."""

    d_max_m: float = Field(
        0.03,
        gt=0,
        le=1,
        description=(
            "Distances are clipped here, in metres. The paper has 0.01, with a thousand times as "
            "many steps."
        ),
    )
    latent: float = Field(
        0.001, ge=0, le=1000, description="lambda_z, the weight of the codes' mean absolute value."
    )
    noise: float = Field(
        0.01,
        ge=0,
        le=10,
        description="sigma_n, the standard deviation of the noise that is added to codes.",
    )


class FieldTraining(EpochTraining):
    """How a field is trained."""

    epochs: int = Field(
        10,
        ge=1,
        le=10_000_000,
        description=(
            "Passes over the training garments, each of which is visited several times; schedules "
            "are relative to this number."
        ),
    )
    visits: int = Field(8, ge=1, le=1_000_000, description="Visits to each garment in an epoch.")
    batch: int = Field(
        12, ge=2, le=4096, description="Garments per step; the image encoder normalises over them."
    )
    near: int = Field(
        128, ge=1, le=100_000, description="Points near the surface per garment and step."
    )
    space: int = Field(
        64,
        ge=1,
        le=100_000,
        description=(
            "Points of the space around it per garment and step; garments for the whole body have "
            "twice as many."
        ),
    )
    learning_rate: float = Field(0.001, gt=0, le=1, description="Learning rate of Adam.")
    schedule: Literal["constant", "late_decay", "one_cycle"] = Field(
        "one_cycle",
        description=(
            "Schedule of the learning rates; late_decay is the paper's, constant for the first "
            "half and then falling to zero."
        ),
    )
    optimizer: Literal["adam", "muon"] = Field(
        "muon",
        description=(
            "Adam as in the paper, or Muon for the decoder's matrices with Adam for the rest."
        ),
    )
    muon_rate: float = Field(
        20, gt=0, le=10_000, description="Learning rate of Muon as a multiple of learning_rate."
    )
    query_rate: float = Field(
        0.05,
        ge=0,
        le=10_000,
        description=(
            "Learning rate of the first query layer as a multiple of learning_rate. Its weights "
            "for all clusters move alike, so a step is larger than it looks."
        ),
    )
    style_rate: float = Field(
        5,
        ge=0,
        le=10_000,
        description=(
            "Learning rate of the training garments' styles as a multiple of learning_rate."
        ),
    )


class FieldSettings(Settings):
    """Everything that a model of SMPLicit is built from besides its data."""

    network: FieldNetwork = FieldNetwork()
    loss: FieldLoss = FieldLoss()
    training: FieldTraining = FieldTraining()


class Meshing(Settings):
    """Surfaces of the fields."""

    cell_m: float = Field(
        0.012, ge=0.001, le=0.05, description="Side of the finest cells in metres."
    )
    threshold_m: float = Field(
        0.01,
        gt=0,
        le=0.05,
        description=(
            "t_d, the distance from the cloth at which the walls lie, in metres. The paper's "
            "0.0001 is far below what its cells resolve."
        ),
    )


class FieldFitSettings(Settings):
    """How codes of held-out garments are fitted to samples of their fields."""

    steps: int = Field(
        14,
        ge=1,
        le=100_000,
        description=(
            "Steps of least squares with a part of the points, and as many with all of them."
        ),
    )
    near: int = Field(384, ge=1, le=100_000, description="Points near the surface per garment.")
    space: int = Field(
        384, ge=1, le=100_000, description="Points of the space around it per garment."
    )
    latent: float = Field(
        0.01,
        ge=0,
        le=1000,
        description=(
            "Weight of the codes' mean absolute value. It keeps them close to those of training "
            "garments."
        ),
    )


class FitImage(Settings):
    """How garments are fitted to the silhouettes of a picture."""

    points: int = Field(
        150_000,
        ge=1000,
        le=10_000_000,
        description="Points drawn in the model's box; those out of the body's reach are dropped.",
    )
    neighbours: int = Field(
        8,
        ge=1,
        le=1000,
        description="Vertices of the body that a point follows into the pose; 1 in the paper.",
    )
    ray_m: float = Field(
        0.01,
        ge=0.001,
        le=0.1,
        description="Side of the squares of pixels that count as one ray, in metres on the body.",
    )
    rays: int = Field(
        400,
        ge=10,
        le=100_000,
        description="Rays on the garment, and as many off it, that count in a step.",
    )
    near: int = Field(2, ge=1, le=100, description="Points of each ray that count in a step.")
    starts: int = Field(
        32,
        ge=0,
        le=10_000,
        description="Training codes that are tried as a start, beside their mean.",
    )
    rounds: int = Field(6, ge=1, le=1000, description="How often rays and points are chosen anew.")
    steps: int = Field(10, ge=1, le=10_000, description="Steps of Adam in each round.")
    rate: float = Field(
        0.2, gt=0, le=10, description="First learning rate, in units of the codes' spread."
    )
    off_weight: float = Field(
        0.7, ge=0, le=1000, description="Weight of a ray off the garment; rays on it have weight 1."
    )
    prior: float = Field(
        0.03,
        ge=0,
        le=1000,
        description=(
            "Weight of the code's mean square distance from the training codes' mean, in units of "
            "their spread."
        ),
    )
    clearance: bool = Field(
        True,
        description=(
            "Whether points near the silhouette may be closer to the garment than d_max; with "
            "false all have to be d_max off, as equation 6 asks."
        ),
    )
    least_px: int = Field(
        50,
        ge=1,
        le=10_000_000,
        description=(
            "Garments with fewer pixels are left out, unless the picture's file asks for them."
        ),
    )
    smoothing: int = Field(
        20,
        ge=0,
        le=1000,
        description="Passes that smooth a skinned garment's motion into the pose; 0 in the paper.",
    )
    hang_frames: int = Field(
        12,
        ge=0,
        le=300,
        description=(
            "Frames for which the fast cloth solver lets the garments that were found hang on "
            "people in their pose, before codes are fitted once more and after it; with 0 "
            "garments are skinned."
        ),
    )


class FitScan(Settings):
    """How codes are fitted to segmented scans (section 4.2)."""

    cloth: int = Field(500, ge=10, le=1_000_000, description="Points on each garment that count.")
    around: int = Field(
        750,
        ge=3,
        le=1_000_000,
        description=(
            "Points off it that count, a third of them next to it in space, the others where the "
            "scan shows skin or cloth that the garment would cover."
        ),
    )
    spread_m: float = Field(
        0.02,
        ge=0,
        le=1,
        description="Standard deviation of the distance of those in space, in metres.",
    )
    uncovered_weight: float = Field(
        3,
        ge=0,
        le=1000,
        description=(
            "Weight of points where the scan shows skin or cloth that the garment would cover; "
            "that of others is 1. Cloth in motion is wider than any at rest, so that with equal "
            "weights larger garments would fit."
        ),
    )
    starts: int = Field(
        32,
        ge=0,
        le=10_000,
        description="Training codes that are tried as a start, beside their mean.",
    )
    steps: int = Field(15, ge=0, le=1000, description="Steps of least squares for codes alone.")
    joint_steps: int = Field(8, ge=0, le=1000, description="Steps for body and codes together.")
    weight: float = Field(
        180,
        ge=0,
        le=1_000_000,
        description="Weight of a garment's points, as a number of independent ones.",
    )
    field_m: float = Field(
        0.005, gt=0, le=1, description="How far fields are off the distances in a scan, in metres."
    )
    neighbours: int = Field(
        1,
        ge=1,
        le=1000,
        description="Vertices of the body that a point follows back to rest; 1 in the paper.",
    )
    hang_frames: int = Field(
        12,
        ge=0,
        le=300,
        description=(
            "Frames for which the fast cloth solver lets garments hang on the body that was "
            "found, before codes are fitted once more and after it; with 0 garments are skinned."
        ),
    )


class FieldSampling(Settings):
    """Samples of the fields."""

    near: int = Field(
        4096,
        ge=64,
        le=1_000_000,
        description=(
            "Points per garment near its surface. Codes are fitted to the first half of the "
            "points; errors are measured at the others."
        ),
    )
    space: int = Field(
        4096,
        ge=64,
        le=1_000_000,
        description=(
            "Points per garment in the space around it, one half uniform in the model's box, the "
            "others near the skin and beyond the garment's openings."
        ),
    )
    clusters: int = Field(
        500,
        ge=1,
        le=10_000,
        description="K, the number of the body's vertices that points are measured from.",
    )
    resolution: int = Field(
        64, ge=32, le=1024, description="Side of the occlusion images in pixels."
    )


class Gallery(Settings):
    """What `snakemake smplicit_gallery` makes of the trained models."""

    models: Annotated[tuple[_Model, ...], EachOnce()] = Field(
        tuple(FIELD_MODELS), min_length=1, description="Models to show."
    )
    count: int = Field(
        6, ge=1, le=1000, description="Garments sampled from each distribution of codes."
    )
    sample: str | None = Field(
        None, description="Sample whose body in motion wears a garment; null takes the first."
    )
    frames: int = Field(
        60, ge=2, le=10_000, description="Frames of that motion, from its first one."
    )
    simulate: bool = Field(
        True,
        description=(
            "Whether the garment in motion is simulated by the fast cloth solver, as cotton. If "
            "not, or if the simulation is out of `simulation.bounds`, it is skinned, which is all "
            "that the paper does."
        ),
    )
    skinning: Literal["nearest", "smoothed"] = Field(
        "smoothed",
        description=(
            "What a skinned garment in motion follows; nearest, the nearest vertex of the body, "
            "as in the paper, or smoothed, many around it, smoothed over the cloth."
        ),
    )
    push_out: bool = Field(
        True,
        description=(
            "Whether vertices of the garment that get into the body in motion are pushed out of "
            "it, which the paper does not do."
        ),
    )


class EvaluatedPictures(Settings):
    """Pictures of held-out samples that the fit is evaluated on."""

    count: int = Field(
        4,
        ge=1,
        le=1000,
        description=(
            "Pictures of all published samples together, spread over them, their frames, and sides."
        ),
    )
    others: int = Field(
        8,
        ge=0,
        le=1000,
        description=(
            "Samples of the test split of each group that is not published that are pictured too, "
            "each once, the first ones, which take turns over its clips."
        ),
    )
    size_px: int = Field(256, ge=32, le=4096, description="Their width and height.")


class SegmentedScans(OwnScans):
    """Inputs of `snakemake fit_scans`, whose points are segmented."""

    garments: Annotated[tuple[Annotated[str, OneOf(GARMENTS)], ...], EachOnce()] = Field(
        (),
        description=(
            "Garments of the person, from the innermost to the outermost; points have the label 1 "
            "for the first, 2 for the second, 0 for skin."
        ),
    )


class SmplicitSettings(Settings):
    """SMPLicit, from distance fields of garments at rest to codes of their cut and style."""

    model_config = ConfigDict(title="SMPLicit")

    models: Annotated[tuple[_Model, ...], EachOnce()] = Field(
        tuple(FIELD_MODELS),
        min_length=1,
        description=(
            "Models to train. Garments of the upper body, trousers and skirts have one each, as "
            "in the paper; whole, for dresses and jumpsuits, is ours."
        ),
    )
    data: FieldSampling = FieldSampling()
    network: FieldNetwork = FieldNetwork()
    loss: FieldLoss = FieldLoss()
    training: FieldTraining = FieldTraining()
    trainer: Trainer = Trainer()
    meshing: Meshing = Meshing()
    evaluation: FieldFitSettings = FieldFitSettings()
    gallery: Gallery = Gallery()
    images: Annotated[tuple[str, ...], EachOnce()] = Field(
        (),
        description=(
            "Pictures of dressed people for `snakemake fit_images`, a .json for each, or folders "
            "of them; docs/how-to/own-pictures.md has the format."
        ),
    )
    fit_images: FitImage = FitImage()
    evaluate_images: EvaluatedPictures = EvaluatedPictures()
    fit_scans: FitScan = FitScan()
    scans: SegmentedScans = SegmentedScans()
