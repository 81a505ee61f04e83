"""Settings of Garment4D, and what its ablations change in them."""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from drapeline.dataset.settings import CloudSettings, OwnScans, Protocol
from drapeline.learning_data.settings import SkinnedSettings
from drapeline.models.training.settings import EpochTraining, Trainer
from drapeline.outfits.garment_types import GARMENT4D_TYPES, GARMENTS
from drapeline.registration.settings import RefineSettings, TemplateFitSettings
from drapeline.settings import ConfigDict, EachOnce, Field, OneOf, Settings, SkipJsonSchema

# Points per cloud in the released code.
_POINTS = 6890
PAPER_FRAMES = 10  # T of a window
RELEASED_INTERPENETRATION = 100  # lambda_7 of equation 7 in the released code
_Garment = Annotated[str, OneOf(GARMENTS)]
_Path = Annotated[str, Field(min_length=1)]
_PULLED = {"network": {"pull_neighbours": 4, "smooth_passes": 8}}
# Variant -> group -> setting -> value, laid over the experiment's settings of the posed stage.
POSED_VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "posed": {},
    "no_body_encoder": {"network": {"body_encoder": False}},
    "no_transformer": {"network": {"transformer": "none"}},
    # With the loss of the released code.
    "released_loss": {
        "loss": {
            "interpenetration": RELEASED_INTERPENETRATION,
            "laplacian_form": "released",
            "temporal_form": "released",
        }
    },
    # With what is ours: vertices drawn to points, and displacements averaged over frames.
    "pulled": _PULLED,
    # Weights of the nearest body vertex, as in SMPL+D.
    "nearest_weights": {"skinning": {"neighbours": 1, "passes": 0}},
}
# The same of MGN*.
MGN_VARIANTS: dict[str, dict[str, dict[str, Any]]] = {"mgn": {}, "mgn_pulled": _PULLED}


class Garment4dTraining(EpochTraining):
    """Length, speed and windows of the training of a stage's network."""

    epochs: int = Field(
        5,
        ge=1,
        le=10_000,
        description="Passes over the training windows; schedules are relative to this number.",
    )
    batch: int = Field(1, ge=1, le=4096, description="Windows per step.")
    learning_rate: float = Field(0.003, gt=0, le=1, description="Learning rate of Adam.")
    schedule: Literal["constant", "one_cycle"] = Field(
        "one_cycle", description="Schedule of the learning rate."
    )
    frames: int = Field(4, ge=1, le=300, description="Frames T of a window.")
    stride: int = Field(
        4, ge=1, le=300, description="Frames from one training window to the next; at most T."
    )
    sources: Annotated[tuple[Literal["simulated", "skinned"], ...], EachOnce()] = Field(
        ("simulated", "skinned"),
        min_length=1,
        description=(
            "Train on simulated samples, on static outfits moved by skinning, or on both. The "
            "skinned ones show the canonical stage many more garments; they have no folds of "
            "their own, so the posed stages leave them out."
        ),
    )


class SkinningSettings(Settings):
    """Skinning weights of proposals (equation 2)."""

    neighbours: int = Field(
        256,
        ge=1,
        le=4096,
        description="Body vertices K that skinning weights are interpolated from.",
    )
    passes: int = Field(
        8,
        ge=0,
        le=10_000,
        description=(
            "Passes of Laplacian smoothing; 8 reach as far on edges of 3.5 cm as 100 on edges of "
            "1 cm."
        ),
    )
    power: int = Field(1, ge=1, le=2, description="Power of the inverse distance.")
    coincident: Literal["vertex", "released"] = Field(
        "vertex",
        description=(
            "A body vertex at distance 0 counts alone, or not at all as in the released code."
        ),
    )


class StageSettings(Settings):
    """All that a network of a stage is built from besides the garment space."""

    network: Any
    loss: Any
    training: Garment4dTraining = Garment4dTraining()


class Abstraction(Settings):
    """Sizes of a set abstraction; the last three have an entry for each ball size."""

    centres: int = Field(description="number of points that are kept")
    radii: tuple[float, ...] = Field(description="radii of the balls, metres")
    neighbours: tuple[int, ...] = Field(description="maximum numbers of points per ball")
    widths: tuple[tuple[int, ...], ...] = Field(description="features after each layer")

    @property
    def outputs(self) -> int:
        """Features per centre."""
        return sum(layers[-1] for layers in self.widths)


def _abstraction(
    centres: int,
    radii: tuple[float, ...],
    neighbours: tuple[int, ...],
    widths: tuple[tuple[int, ...], ...],
) -> Abstraction:
    return Abstraction(centres=centres, radii=radii, neighbours=neighbours, widths=widths)


class CanonicalLayers(Settings):
    """Layers of the canonical network; defaults are those of the released code."""

    segmentation: tuple[Abstraction, ...] = Field(
        (
            _abstraction(1024, (0.05, 0.1), (16, 32), ((16, 16, 32), (32, 32, 64))),
            _abstraction(256, (0.1, 0.2), (16, 32), ((32, 32, 64), (64, 64, 128))),
            _abstraction(64, (0.2, 0.4), (32, 64), ((64, 64, 128), (128, 128, 256))),
        ),
        strict=False,
        description="Abstractions of all points, finest first.",
    )
    propagation: tuple[tuple[int, ...], ...] = Field(
        ((512, 256), (256, 128), (128, 64)),
        description="Features after each layer on the way back, coarsest first.",
    )
    garment_points: int = Field(
        1722, description="Largest number of points per cloud that the garment encoder is given."
    )
    garment: tuple[Abstraction, ...] = Field(
        (
            _abstraction(512, (0.05, 0.1), (16, 32), ((32, 32), (64, 64))),
            _abstraction(64, (0.2, 0.4), (32, 64), ((128, 128), (256, 256))),
        ),
        strict=False,
        description="Abstractions of the garment's points, finest first.",
    )
    overall: tuple[int, ...] = Field(
        (512, 512),
        description="Features after each layer before the maximum over points and frames.",
    )
    head: tuple[int, ...] = Field(
        (128, 64),
        description="Features after each layer between that maximum and the coefficients.",
    )

    def scale(self, points: int, width: float) -> "CanonicalLayers":
        """The same network for sparser clouds, and thinner.

        The points of a cloud of `points` are f = sqrt(6890 / points) times as far apart. The finest
        radii grow by f, so that balls hold as many points as before, and the others, of whose
        centres there are 1 / f as many, by sqrt(f).

        Args:
            points: per cloud.
            width: factor on the features of all layers.
        """
        spread = math.sqrt(_POINTS / points)

        def thinner(widths: Sequence[int]) -> tuple[int, ...]:
            return tuple(max(round(width * size), 4) for size in widths)

        def fewer(levels: Sequence[Abstraction]) -> tuple[Abstraction, ...]:
            return tuple(
                level.replace(
                    centres=max(round(level.centres / spread), 1),
                    radii=tuple(r * spread ** (0.5 if coarser else 1) for r in level.radii),
                    widths=tuple(thinner(layers) for layers in level.widths),
                )
                for coarser, level in enumerate(levels)
            )

        return CanonicalLayers(
            segmentation=fewer(self.segmentation),
            propagation=tuple(thinner(layers) for layers in self.propagation),
            garment_points=max(round(self.garment_points / spread**2), 1),
            garment=fewer(self.garment),
            overall=thinner(self.overall),
            head=thinner(self.head),
        )


class SegmentationSettings(Settings):
    """A network that labels points, as the released one scaled to clouds and width."""

    width: float = Field(
        0.25, gt=0, le=4, description="Factor on the number of features of all layers."
    )
    points: SkipJsonSchema[int] = Field(1024, ge=1, description="Points per cloud.")
    layers: SkipJsonSchema[CanonicalLayers] = CanonicalLayers()

    def scaled_layers(self) -> CanonicalLayers:
        """Its layers."""
        return self.layers.scale(self.points, self.width)


class CanonicalSettings(SegmentationSettings):
    """The canonical network."""

    garment_points: Annotated[int, Field(ge=16, le=100_000)] | None = Field(
        None,
        description=(
            "Largest number of garment points that the shape is made from; null means a quarter "
            "of a cloud's points."
        ),
    )

    def scaled_layers(self) -> CanonicalLayers:
        """Its layers."""
        scaled, most = super().scaled_layers(), self.garment_points
        return scaled if most is None else scaled.replace(garment_points=most)


_Balance = Annotated[
    float,
    Field(
        ge=0,
        le=1,
        description=(
            "Weight of a point is its label's share of the training points to the power of minus "
            "this; tops have only 8 % of the points. The paper's is 0."
        ),
    ),
]


class LabelWeights(Settings):
    """The loss of labels."""

    balance: _Balance = 0.5


class LabelStageSettings(StageSettings):
    """The network that labels points for our model."""

    network: SegmentationSettings = SegmentationSettings()
    loss: LabelWeights = LabelWeights()
    training: Garment4dTraining = Garment4dTraining(epochs=3)


class CanonicalWeights(Settings):
    """lambda_1 to lambda_5 of equation 4."""

    segmentation: float = Field(1.0, ge=0, le=1_000_000, description="lambda_1 of equation 4.")
    vertices: float = Field(40, ge=0, le=1_000_000, description="lambda_3 of equation 4.")
    coefficients: float = Field(0.001, ge=0, le=1_000_000, description="lambda_2 of equation 4.")
    interpenetration: float = Field(50, ge=0, le=1_000_000, description="lambda_4 of equation 4.")
    laplacian: float = Field(1, ge=0, le=1_000_000, description="lambda_5 of equation 4.")
    laplacian_form: Literal["paper", "released"] = Field(
        "paper",
        description=(
            "Squared lengths of Lx against those of the truth, or lengths as in the released code."
        ),
    )
    balance: _Balance = 0.5


class CanonicalStageSettings(StageSettings):
    """The canonical stage, and the PN++ baseline."""

    network: CanonicalSettings = CanonicalSettings()
    loss: CanonicalWeights = CanonicalWeights()


class PulledSettings(Settings):
    """What may be added to the paper's posed networks."""

    pull_neighbours: int = Field(
        0,
        ge=0,
        le=64,
        description=(
            "In each iteration, vertices move by a learned share towards the mean of this many "
            "nearest garment points; 0 as in the paper."
        ),
    )
    smooth_passes: int = Field(
        0,
        ge=0,
        le=200,
        description=(
            "Passes of averaging over neighbouring frames, on the displacements of a whole "
            "reconstructed sequence; 0 as in the paper. A change retrains the stage."
        ),
    )


class PosedSettings(PulledSettings):
    """Sizes of the posed network."""

    iterations: int = Field(3, ge=1, le=20, description="Number of displacements J.")
    hidden: int = Field(64, ge=1, le=4096, description="Features of the graph convolutions.")
    layers: int = Field(4, ge=2, le=20, description="Graph convolutions per iteration.")
    features: int = Field(16, ge=1, le=1024, description="Features per ball.")
    ball_layers: int = Field(
        1,
        ge=1,
        le=4,
        description=(
            "Layers of the perceptron within each ball; with 1, features are computed before they "
            "are gathered."
        ),
    )
    garment_radii_m: tuple[Annotated[float, Field(gt=0, le=2)], ...] = Field(
        (0.1, 0.2, 0.4),
        min_length=1,
        description="Radii of the balls of garment points at each level, in metres.",
    )
    garment_counts: tuple[Annotated[int, Field(ge=1, le=8192)], ...] = Field(
        (32, 16, 8), min_length=1, description="Points per ball at each level."
    )
    body_radii_m: tuple[Annotated[float, Field(gt=0, le=2)], ...] = Field(
        (0.1, 0.2, 0.4),
        min_length=1,
        description="Radii of the balls of body vertices at each level, in metres.",
    )
    body_counts: tuple[Annotated[int, Field(ge=1, le=8192)], ...] = Field(
        (8, 16, 32), min_length=1, description="Vertices per ball at each level."
    )
    transformer: Literal["paper", "per_vertex", "none"] = Field(
        "paper",
        description=(
            "Attention between frames for all vertices together, for each vertex alone, or none."
        ),
    )
    body_encoder: SkipJsonSchema[bool] = Field(
        True, description="Whether features of the body are used; the ablation of figure 6."
    )


class PosedWeights(Settings):
    """Weights of the loss of equation 7."""

    vertices: float = Field(20, ge=0, le=1_000_000, description="lambda_6 of equation 7.")
    interpenetration: float = Field(
        10,
        ge=0,
        le=1_000_000,
        description=(
            "lambda_7 of equation 7. The released code has 100, with which a few hundred steps do "
            "little but push cloth out."
        ),
    )
    laplacian: float = Field(10, ge=0, le=1_000_000, description="lambda_8 of equation 7.")
    temporal: float = Field(5, ge=0, le=1_000_000, description="lambda_9 of equation 7.")
    laplacian_form: Literal["paper", "released"] = Field(
        "paper",
        description=(
            "As in equation 6, or only the length of the uniform Lx as in the released code."
        ),
    )
    temporal_form: Literal["paper", "released"] = Field(
        "paper",
        description=(
            "Squared distances of all iterations, or distances of the last one only as in the "
            "released code."
        ),
    )


class PosedStageSettings(StageSettings):
    """The posed stage."""

    network: PosedSettings = PosedSettings()
    loss: PosedWeights = PosedWeights()
    training: Garment4dTraining = Garment4dTraining(
        epochs=1, learning_rate=0.0007, sources=("simulated",)
    )
    skinning: SkipJsonSchema[SkinningSettings] = SkinningSettings()


class MgnSettings(PulledSettings):
    """Sizes of the MGN* baseline."""

    widths: tuple[Annotated[int, Field(ge=1, le=8192)], ...] = Field(
        (256, 512, 1024), min_length=1, description="Features of each layer."
    )
    scale_m: float = Field(
        0.05, gt=0, le=1, description="Displacement per unit of output, in metres."
    )


class MgnStageSettings(StageSettings):
    """The MGN* baseline."""

    network: MgnSettings = MgnSettings()
    loss: SkipJsonSchema[PosedWeights] = PosedWeights()
    training: Garment4dTraining = Garment4dTraining(
        epochs=1, learning_rate=0.002, sources=("simulated",)
    )
    skinning: SkipJsonSchema[SkinningSettings] = SkinningSettings(neighbours=1, passes=0)


class EvaluationSettings(Settings):
    """Evaluations besides that of the plain reconstruction."""

    stride: int = Field(
        0, ge=0, le=300, description="Frames from one window to the next; at most T, and 0 means T."
    )
    neighbours: Annotated[tuple[Annotated[int, Field(ge=1, le=4096)], ...], EachOnce()] = Field(
        (1, 16, 256), description="Values of K for figure 8."
    )
    missing: Annotated[tuple[Annotated[float, Field(ge=0, le=0.95)], ...], EachOnce()] = Field(
        (0.3, 0.8), description="Shares of missing points for figure 9."
    )
    accuracy: Annotated[tuple[Annotated[float, Field(ge=0, le=1)], ...], EachOnce()] = Field(
        (1.0, 0.7), description="Shares of correct labels for figure 10."
    )
    body_noise_rad: Annotated[tuple[Annotated[float, Field(ge=0, le=1)], ...], EachOnce()] = Field(
        (0.05, 0.1),
        description=(
            "Standard deviations of noise on the poses of the body, in radians, the same in all "
            "frames; ten times as much is on its shape coefficients."
        ),
    )
    point_noise_m: Annotated[tuple[Annotated[float, Field(ge=0, le=1)], ...], EachOnce()] = Field(
        (0.01,), description="Standard deviations of noise on points, in metres."
    )
    views: Annotated[tuple[Annotated[int, Field(ge=1, le=64)], ...], EachOnce()] = Field(
        (1, 2), description="Numbers of cameras around the person that see the points."
    )
    frame_rates: Annotated[tuple[Literal[15, 10, 6, 5, 3], ...], EachOnce()] = Field(
        (15,), description="Frames that are given of every second, instead of all 30."
    )
    seed: SkipJsonSchema[int] = Field(0, description="Seed of holes, labels, noise and intervals.")

    @property
    def degrades(self) -> bool:
        """Whether anything is measured with worse inputs."""
        noise = self.body_noise_rad, self.point_noise_m
        return any((self.missing, self.accuracy, *noise, self.views, self.frame_rates))


class Template(Settings):
    """Templates that the garments of a type are registered to."""

    edge_length_m: float = Field(
        0.035, ge=0.005, le=0.1, description="Mean edge length of the templates, in metres."
    )
    files: dict[_Garment, _Path] = Field(
        {}, description="Your own templates, OBJ in metres on the rest body of mean shape."
    )


class Skinned(SkinnedSettings):
    """Static outfits that skinning puts into motion, to learn from; they are never measured."""

    shards: Annotated[int, Field(ge=0, le=100_000)] | None = Field(
        None, description="Number of shards of static outfits to use; null uses all."
    )


class Reconstruct(OwnScans):
    """Inputs of `snakemake reconstruct`."""

    garment: _Garment = Field("Skirt", description="Garment to reconstruct.")


class Garment4dSettings(Settings):
    """Garment4D, from point-cloud sequences to posed garments."""

    model_config = ConfigDict(title="Garment4D")

    garments: Annotated[tuple[_Garment, ...], EachOnce()] = Field(
        GARMENT4D_TYPES,
        min_length=1,
        description=(
            "Garment types that the models are compared on, with networks of their own for each. "
            "`reconstruct` is not bound to them: our model learns any type when it is asked for."
        ),
    )
    template: Template = Template()
    registration: TemplateFitSettings = Field(
        TemplateFitSettings(), description="Registration of garments to templates."
    )
    components: int = Field(
        64,
        ge=1,
        le=1024,
        description=(
            "Principal components of a garment type; at most one less than the number of training "
            "garments."
        ),
    )
    protocol: Protocol = Field(
        "surface",
        description="Take points on the visible surface, or mesh vertices as in the released code.",
    )
    clouds: CloudSettings = Field(CloudSettings(), description="Point clouds.")
    skinned: Skinned = Skinned()
    body_points: int = Field(
        1000, ge=16, le=100_000, description="Body vertices that the networks see."
    )
    skinning: SkinningSettings = SkinningSettings()
    labels: LabelStageSettings = Field(
        LabelStageSettings(),
        description="Labels of points for our model, one network for all types that are worn.",
    )
    canonical: CanonicalStageSettings = CanonicalStageSettings()
    posed: PosedStageSettings = PosedStageSettings()
    mgn: MgnStageSettings = MgnStageSettings()
    trainer: Trainer = Trainer()
    refine: RefineSettings = Field(RefineSettings(), description="Our final step.")
    proposals: Literal["skinned", "simulated", "best"] = Field(
        "best",
        description=(
            "How garments move before our final step lays them on the points: with the body by "
            "skinning, by the fast cloth solver, or, of all but upper garments, by what is closer "
            "on validation sequences. A change fits our model again."
        ),
    )
    evaluation: EvaluationSettings = EvaluationSettings()
    reconstruct: Reconstruct = Reconstruct()


def posed_variants(
    settings: Mapping[str, Mapping[str, Any]],
) -> dict[str, dict[str, dict[str, Any]]]:
    """Variant -> group -> setting -> value: the full model, and what differs from these settings.

    Settings that these lack differ.
    """
    return {
        name: changes
        for name, changes in POSED_VARIANTS.items()
        if not changes
        or any(
            settings.get(group, {}).get(key) != value
            for group, values in changes.items()
            for key, value in values.items()
        )
    }
