"""Settings and variants of the garment VAEs, of their conditioning and of the PCA beside them."""

from collections import ChainMap
from typing import Annotated, Any, Literal

from drapeline.models.training.settings import StepTraining, Trainer
from drapeline.outfits.garment_types import GARMENTS, OUTFIT_TYPES
from drapeline.settings import ConfigDict, EachOnce, Field, OneOf, Settings, SkipJsonSchema

# What ours has and the paper's network has not: variant without it -> setting -> value.
_DEPARTURES: dict[str, dict[str, Any]] = {
    "svae_no_linear_path": {"linear_path": False},
    "svae_shared_moments": {"topology_moments": False},
    "svae_unmasked_input": {"masked_input": False},
    "svae_shared_output": {"vertex_output": False},
}
_PRINTED_LOSS = {
    **{"normals": 70.0, "mask": 0.1, "mask_form": "l1", "condition": 1.0},
    **{"kl_max": 0.25, "kl_selection": 0.1},
}

# Variant -> group -> setting -> value, which replace the experiment's settings of the full model.
SVAE_VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "svae": {},
    "svae_no_normals": {"loss": {"normals": 0.0}},
    # Without a mask the network must learn every vertex, garment or not.
    "svae_no_mask": {
        "network": {"masked_input": False},
        "loss": {"offsets_within": "all"},
        "training": {"mask": False},
    },
    "svae_no_cvar": {"loss": {"condition": 0.0}},
    "svae_uniform_pooling": {},
    **{name: {"network": change} for name, change in _DEPARTURES.items()},
    # Shorter codes, for comparisons with other models'.
    **{f"svae_{size}": {"network": {"latent": size}} for size in (18, 64)},
    "svae_as_printed": {
        "network": dict(ChainMap(*_DEPARTURES.values())),
        "loss": _PRINTED_LOSS,
    },
}

SHORT_SVAES = tuple(name for name in SVAE_VARIANTS if name.removeprefix("svae_").isdecimal())

DVAE_VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    f"dvae_{version}_{frames}": {
        "training": {"version": version, "mask": False},
        "network": {"scale": 2},
    }
    for version in ("posed", "unposed")
    for frames in (1, 4)
}

# Masked probabilistic PCA, which the networks are compared with.
STATIC_PPCA, DYNAMIC_PPCA = "static_ppca", "dynamic_ppca"

# The one that comes with drapeline: half as many numbers as the config's, and half as large.
PACKAGED_LATENT = 64
PACKAGED_PPCA = f"{STATIC_PPCA}_{PACKAGED_LATENT}"

# The network that predicts wrinkles from motion.
WRINKLE_MLP = "wrinkle_mlp"
_FRAMES = {DYNAMIC_PPCA: 4, WRINKLE_MLP: 2}  # that others than the DVAE are conditioned on


# Folder of the network that regresses codes from pictures, and of its evaluation.
PICTURES = "pictures"

# What moves sampled garments: a cloth solver, or the variant of a model of garments in motion.
SOLVER = "solver"
MOVERS = {
    **{"dvae": "dvae_unposed_4", "mlp": WRINKLE_MLP, "ppca": DYNAMIC_PPCA},
    SOLVER: None,
}


def dynamic_conditions(variant: str) -> tuple[str, int]:
    """A dynamic variant's version of the offsets, and the number of poses it is conditioned on."""
    if variant in _FRAMES:
        return "unposed", _FRAMES[variant]
    _, version, frames = variant.split("_")
    return version, int(frames)


def pooling_of(variant: str) -> str:
    """Name of the mesh hierarchy that a variant uses."""
    return "uniform" if variant == "svae_uniform_pooling" else "segments"


# Samples and figures need a mask.
_WITH_MASK = (
    *(name for name, changes in SVAE_VARIANTS.items() if "training" not in changes),
    STATIC_PPCA,
)

_Deviations = Annotated[float, Field(ge=-5, le=5)]

_Weight = Annotated[float, Field(ge=0, le=10_000)]


class GcvaeNetwork(Settings):
    """Sizes of the networks.

    CLOTH3D gives `latent`, `order` and the number of levels.
    """

    scale: SkipJsonSchema[int] = Field(
        1, description="Factor on the widths of all levels but the finest; 2 for the DVAE."
    )
    widths: tuple[Annotated[int, Field(ge=1, le=1024)], ...] = Field(
        (8, 16, 32, 64, 64, 128),
        min_length=1,
        description="Features per node at each of the six levels of the hierarchy, finest first.",
    )
    features: int = Field(
        256,
        ge=1,
        le=8192,
        description="Width of the fully connected layer between the coarsest level and the code.",
    )
    latent: int = Field(128, ge=1, le=1024, description="Dimensions of the latent code.")
    condition: int = Field(
        32, ge=1, le=1024, description="Dimensions of the code of the conditional variables."
    )
    order: int = Field(
        1, ge=1, le=6, description="Order K of the Chebyshev polynomials; 1 means two terms."
    )
    topology_moments: bool = Field(
        True,
        description=(
            "Whether offsets are normalised by mean and deviation of the garments of their own "
            "topology; the paper's are of all."
        ),
    )
    masked_input: bool = Field(
        True,
        description=(
            "Whether the encoder is shown where the garment is, and no offsets elsewhere; in the "
            "paper it sees offsets alone, which are zero there."
        ),
    )
    linear_path: bool = Field(
        True,
        description=(
            "Whether the code is also joined to all vertices by linear layers, as in PCA, so that "
            "graph convolutions have to learn only the rest."
        ),
    )
    vertex_output: bool = Field(
        True,
        description=(
            "Whether the last layer has weights of its own at every vertex; the paper's is a graph "
            "convolution."
        ),
    )

    @property
    def level_widths(self) -> list[int]:
        """Features per node after scaling; the first and the last layer keep theirs."""
        return [self.widths[0], *(self.scale * width for width in self.widths[1:])]


class GcvaeLoss(Settings):
    """Weights and forms of the loss.

    Each term is a mean: offsets over the coordinates of the vertices that count, in units of
    normalised offsets; normals over faces, of the L1 norm of the difference of unit normals; the
    mask over vertices; KL over samples and over the components of z. Read as a sum over z, the
    printed KL weights would leave no information in z (0.25 per nat against an L1 below one).
    """

    normals: float = Field(
        0.02,
        ge=0,
        le=10_000,
        description=(
            "Weight of the normals; with the 70 of the paper, nothing is left for the offsets."
        ),
    )
    mask: float = Field(0.5, ge=0, le=10_000, description="Weight of the mask.")
    condition: float = Field(
        0.1,
        ge=0,
        le=10_000,
        description="Weight of the regression of the conditional variables' code.",
    )
    kl_start: float = Field(
        0.0001,
        ge=0,
        le=1000,
        description="Weight of the KL divergence over the first part of training.",
    )
    kl_flat_share: float = Field(
        0.5, ge=0, le=1, description="Length of that first part, as a share of training."
    )
    kl_rise: float = Field(
        0.005,
        ge=0,
        le=1000,
        description="Increase of the weight per hundredth of training after that part.",
    )
    kl_max: float = Field(0.002, ge=0, le=1000, description="Largest weight.")
    kl_selection: float = Field(
        0.002,
        ge=0,
        le=1000,
        description=(
            "Weight of the KL divergence beside the offsets' error by which the best epoch is "
            "chosen; with the 0.1 of the paper, codes that hold much are never the best."
        ),
    )
    mask_form: Literal["l1", "bce"] = Field(
        "bce", description="Loss on the probabilities of the mask."
    )
    offsets_form: Literal["l1", "distance"] = Field(
        "l1", description="L1 on normalised offsets, or distances in centimetres."
    )
    offsets_within: Literal["mask", "all"] = Field(
        "mask", description="Vertices whose offsets count in the loss."
    )

    def kl_weight(self, share: float) -> float:
        """lambda_KL once `share` (0 to 1) of training is done."""
        rise = self.kl_rise * 100 * max(share - self.kl_flat_share, 0.0)
        return min(self.kl_start + rise, self.kl_max)


class GcvaeTraining(StepTraining):
    """How long and how fast a garment VAE is trained."""

    steps: int = Field(
        1500,
        ge=1,
        le=10_000_000,
        description=(
            "Steps that one device takes, in whole passes over the training garments, as many of "
            "which several devices take together; schedules are relative to this number."
        ),
    )
    batch: int = Field(8, ge=1, le=4096, description="Garments per step, on each device.")
    learning_rate: float = Field(0.001, gt=0, le=1, description="Learning rate of Adam.")
    schedule: Literal["constant", "one_cycle"] = Field(
        "one_cycle", description="Schedule of the learning rate."
    )
    normal_parts: int = Field(
        4,
        ge=1,
        le=64,
        description="Each step computes normals on one of this many subsets of the faces.",
    )
    mask: SkipJsonSchema[bool] = Field(True, description="Whether the decoder predicts the mask.")
    version: SkipJsonSchema[Literal["rest", "posed", "unposed"]] = Field(
        "rest",
        description=(
            "What a DVAE's offsets are measured from: the posed body, or, with unposed, the "
            "static garment. An SVAE has rest."
        ),
    )


class VaeSettings(Settings):
    """The model of garments at rest."""

    network: GcvaeNetwork = GcvaeNetwork()
    loss: SkipJsonSchema[GcvaeLoss] = GcvaeLoss()
    training: GcvaeTraining = GcvaeTraining()


class DvaeSettings(VaeSettings):
    """The model of garments in motion."""

    training: GcvaeTraining = GcvaeTraining(steps=1000)


class AutoencoderTraining(StepTraining):
    """How the autoencoder of the conditions is trained."""

    steps: int = Field(
        500,
        ge=1,
        le=10_000_000,
        description="Steps of the conditioning autoencoder, in whole passes over the garments.",
    )
    batch: SkipJsonSchema[int] = Field(32, ge=1, description="Garments per step.")
    learning_rate: SkipJsonSchema[float] = Field(0.003, gt=0, description="Rate of Adam.")
    schedule: SkipJsonSchema[str] = Field("one_cycle", description="Schedule of that rate.")


class ConditioningSettings(Settings):
    """How the autoencoder of the conditions is built and trained."""

    condition: int = Field(32, ge=1, le=1024, description="Numbers in cvar^z.")
    training: AutoencoderTraining = AutoencoderTraining()


class PpcaSettings(Settings):
    """Settings of a fit of the PCA."""

    latent: int = Field(128, ge=1, le=1024, description="Numbers of a code.")
    seed: int = Field(0, description="Seed of the rows and the vertices that are chosen.")


class _OneCycleTraining(StepTraining):
    learning_rate: float = Field(0.002, gt=0, le=1, description="Learning rate of Adam.")
    schedule: Literal["constant", "one_cycle"] = Field(
        "one_cycle", description="Schedule of the learning rate."
    )


class MlpTraining(_OneCycleTraining):
    """How the network that predicts wrinkles is trained."""

    steps: int = Field(
        1000,
        ge=1,
        le=10_000_000,
        description="Steps of the network that predicts wrinkles, in whole passes over the frames.",
    )
    batch: int = Field(512, ge=1, le=65_536, description="Frames per step.")


class Mlp(Settings):
    """The network that predicts wrinkles from motion, without seeing the frame."""

    width: int = Field(512, ge=1, le=8192, description="Width of its two hidden layers.")
    training: MlpTraining = MlpTraining()


class WrinkleMlpSettings(Mlp, PpcaSettings):
    """The same with the PCA whose codes it predicts."""


class Dvae(DvaeSettings):
    """The model of garments in motion, and what it learns from."""

    static_model: Literal["svae", "static_ppca"] = Field(
        "static_ppca", description="The static model whose codes the dynamic one is conditioned on."
    )
    frame_step: int = Field(3, ge=1, le=300, description="Every n-th frame of a sequence is used.")


class Evaluation(Settings):
    """What the models are compared with."""

    pca_components: int = Field(
        128,
        ge=1,
        le=4096,
        description=(
            "Components of the principal component baselines; at most one less than the number of "
            "training garments."
        ),
    )
    floor_samples: int = Field(
        20,
        ge=0,
        le=99_999,
        description=(
            "Test samples of each group that are simulated again, to tell how far a garment in "
            "motion is from itself; 0 leaves this out."
        ),
    )


class Sampling(Settings):
    """Garments that `snakemake sample_garments` draws."""

    variant: Annotated[str, OneOf(_WITH_MASK)] = Field(
        "static_ppca", description="The static model that samples and figures are made with."
    )
    count: int = Field(24, ge=1, le=99_999, description="Garments to draw.")
    garments: (
        Annotated[tuple[Annotated[str, OneOf(("prior", *GARMENTS))], ...], Field(min_length=1)]
        | None
    ) = Field(
        None,
        description=(
            "Types to take turns over; null takes those of the outfits at rest. prior draws codes "
            "from the standard normal, whatever type results."
        ),
    )
    female_share: float = Field(
        0.6666666666666666, ge=0, le=1, description="Share of female bodies."
    )
    shape: Annotated[tuple[_Deviations, ...], Field(min_length=10, max_length=10)] | None = Field(
        None, description="Body shape of all garments; null draws one for each."
    )
    tightness: tuple[_Deviations, _Deviations] | None = Field(
        None, description="Tightness of all garments; null draws one for each."
    )
    settle: bool = Field(
        True,
        description=(
            "Whether to mend garments after decoding: to fill small holes, smooth them, span dents "
            "and push them out of the body, which the paper does not do; otherwise no vertex is "
            "moved."
        ),
    )
    hang_frames: int = Field(
        12,
        ge=0,
        le=300,
        description=(
            "Frames for which the fast cloth solver then lets garments hang on their wearers, for "
            "pictures and glTF; the OBJ files have them as they are decoded. 0 leaves them so."
        ),
    )


class Animation(Settings):
    """Sampled outfits that `snakemake animate_sampled` sets in motion."""

    count: int = Field(3, ge=1, le=9999, description="Outfits to draw.")
    types: tuple[Annotated[str, OneOf(OUTFIT_TYPES)], ...] | None = Field(
        None,
        min_length=1,
        description="Outfits to take turns over; null takes those of the outfits at rest.",
    )
    movers: Annotated[tuple[Annotated[str, OneOf(tuple(MOVERS))], ...], EachOnce()] = Field(
        ("dvae", "mlp", SOLVER),
        min_length=1,
        description=(
            "What moves them, each for a picture of its own: dvae, the paper's network, with the "
            "mean of its prior; ppca and mlp, a linear model and a network that predict wrinkles "
            "from motion; solver, the fast cloth solver."
        ),
    )
    clip: str | None = Field(
        None,
        description="Clip to put them on, one of the samples' in motion; null takes a test clip.",
    )
    frames: int = Field(
        60, ge=2, le=300, description="Frames of the clip; fewer where it has no more."
    )


class PictureViews(Settings):
    """Pictures that a network learns codes from."""

    size_px: int = Field(
        64,
        ge=16,
        le=1024,
        description="Width and height of the pictures that the network sees, cut to the body.",
    )
    per_outfit: int = Field(
        12,
        ge=1,
        le=10_000,
        description="Pictures of each outfit at rest, in as many poses of samples.",
    )
    seed: SkipJsonSchema[int] = Field(0, description="Seed of the poses and of the cameras.")


class PictureTraining(_OneCycleTraining):
    """How the network of pictures is trained."""

    steps: int = Field(
        1000,
        ge=1,
        le=10_000_000,
        description="Steps of the network of pictures, in whole passes over them.",
    )
    batch: int = Field(32, ge=2, le=4096, description="Garments in pictures per step.")


class PictureNetwork(Settings):
    """The network that regresses codes from pictures."""

    width: int = Field(
        16,
        ge=1,
        le=1024,
        description="Channels of the first stage of the ResNet-18, 64 of the common one.",
    )
    training: PictureTraining = PictureTraining()


class Pictures(PictureNetwork):
    """Codes of garments at rest from pictures of them as they are worn."""

    views: PictureViews = PictureViews()


class GcvaeSettings(Settings):
    """The graph conditional variational auto-encoders of garments at rest (svae) and in motion
    (dvae).
    """

    model_config = ConfigDict(title="Garment VAEs")

    svae: VaeSettings = VaeSettings()
    dvae: Dvae = Dvae()
    mlp: Mlp = Mlp()
    loss: GcvaeLoss = GcvaeLoss()
    conditioning: AutoencoderTraining = AutoencoderTraining()
    trainer: Trainer = Trainer()
    evaluation: Evaluation = Evaluation()
    sampling: Sampling = Sampling()
    animation: Animation = Animation()
    pictures: Pictures = Pictures()
