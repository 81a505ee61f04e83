"""The whole config: the settings of all rooms, and of the models.

Room by room they are declared beside what they are for; here they get their place in a config.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import create_model

from drapeline.bodies.settings import BodyFit
from drapeline.dataset.settings import ScanSettings
from drapeline.frames import GENDERS
from drapeline.generation.settings import BodySettings, OutfitSettings
from drapeline.models.garment4d.settings import Garment4dSettings
from drapeline.models.gcvae.settings import GcvaeSettings
from drapeline.models.smplicit.settings import SmplicitSettings
from drapeline.outfits.garment_types import EVEN_OUTFIT_TYPES, GARMENTS, OUTFIT_TYPES
from drapeline.outfits.settings import OwnGarmentFiles
from drapeline.settings import EachOnce, Field, OneOf, Settings
from drapeline.simulation.settings import HealthBounds, SimulationSettings

# Block of a config -> its settings.
MODELS: dict[str, type[Settings]] = {
    "gcvae": GcvaeSettings,
    "garment4d": Garment4dSettings,
    "smplicit": SmplicitSettings,
}
# Names of cloth solvers.
Solver = Literal["blender", "xpbd"]
_Path = Annotated[str, Field(min_length=1)]
_Outfit = Annotated[str, OneOf(OUTFIT_TYPES)]
_Sequence = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")]
_Speed = Annotated[float, Field(ge=0.25, le=4)]


class Body(BodySettings):
    """Bodies, from the user's files or the free ones."""

    files: dict[Annotated[str, OneOf(GENDERS)], _Path] = Field(
        {},
        json_schema_extra={"dependentRequired": {"female": ["male"], "male": ["female"]}},
        description=(
            "Your own licensed SMPL files (.npz or .pkl). Without them, the free Anny body is used."
        ),
    )
    female_share: float = Field(
        0.6666666666666666, ge=0, le=1, description="Share of female bodies; the paper has 2/3."
    )


class Motions(Settings):
    """Clips, and the pieces of them that samples move through."""

    table: Annotated[str, Field(min_length=1)] | None = Field(
        None,
        description=(
            "Your own table of motion files (docs/how-to/own-motion.md); null means the clips "
            "that come with drapeline."
        ),
    )
    sequences: Annotated[tuple[_Sequence, ...], EachOnce()] = Field(
        (), description="Sequences of the table to use, in this order; an empty list means all."
    )
    loop_frames: int = Field(
        300,
        ge=1,
        le=9000,
        description="Cyclic clips are repeated to this length, in frames at 30 fps.",
    )
    frames: int = Field(
        300, ge=1, le=300, description="Length of a sub-sequence in frames at 30 fps."
    )
    frames_min: Annotated[int, Field(ge=1, le=300)] | None = Field(
        None,
        description=(
            "Shortest sub-sequence; a shorter remainder of a clip is dropped, a shorter clip "
            "refused. Null means a second (30), or all of `frames` where that is less."
        ),
    )
    lock_feet: bool = Field(
        True,
        description=(
            "Bend the legs of BVH and AMC motions so that resting feet neither slide nor float."
        ),
    )


class Samples(Settings):
    """How many samples there are, and their splits."""

    count: Annotated[int, Field(ge=1, le=99_999)] | None = Field(
        None,
        description=(
            "Samples to make, taking turns over the sequences; null makes one of each sub-sequence."
        ),
    )
    val_share: float = Field(0.1, ge=0, le=0.5, description="Share of the samples for validation.")
    test_share: float = Field(0.2, ge=0, le=0.5, description="Share of the samples for testing.")
    shard_size: Annotated[int, Field(ge=1, le=1000)] | None = Field(
        None,
        description=(
            "Samples per job, on clusters; with null, each step of each sample is a job of its "
            "own. The samples are the same."
        ),
    )


class Outfits(OutfitSettings):
    """What bodies wear."""

    types: tuple[_Outfit, ...] = Field(
        OUTFIT_TYPES,
        min_length=1,
        description="Outfits to take turns over; one that is listed twice gets two turns.",
    )
    male_skirts: bool = Field(
        False, description="Whether male bodies also wear skirts and dresses."
    )
    own_garments: dict[Annotated[str, OneOf(GARMENTS)], _Path | OwnGarmentFiles] = Field(
        {},
        strict=False,
        description="Your own OBJ files, aligned with the rest body, to use instead of a template.",
    )


class Simulation(Settings):
    """Cloth that moves."""

    solver: Solver = Field(
        "blender",
        description=(
            "The cloth solver that moves the garments. `blender` is the reference; `xpbd`, ours, "
            "is about eight times as fast."
        ),
    )
    accelerator: Literal["cpu", "gpu", "auto"] = Field(
        "cpu",
        description=(
            "What the fast cloth solver works on, for the dataset, the learning group and outfits "
            "that settle. `auto` takes a GPU where there is one. Jobs take turns on a GPU, so it "
            "pays where they are few or meshes are fine. Results differ in their last digits, and "
            "so in their folds."
        ),
    )
    settings: SimulationSettings = SimulationSettings()
    bounds: HealthBounds = HealthBounds()


class Registration(Settings):
    """What garments are offsets from."""

    vertices: int = Field(
        14_475,
        ge=0,
        le=200_000,
        description="Vertices of the super-resolved body; 0 only removes head, hands and feet.",
    )


class Learning(Settings):
    """More simulated samples, with bodies, outfits and pieces of clips of their own, that networks
    learn from and are tested on. They are not part of the published dataset.
    """

    count: int = Field(
        0,
        ge=0,
        le=1_000_000,
        description="Samples to make; with 0, networks have the dataset's samples alone.",
    )
    solver: Solver = Field("xpbd", description="The cloth solver that moves their garments.")
    attempts: int = Field(
        1,
        ge=1,
        le=5,
        description=(
            "As simulation.settings.attempts. Another sample takes less time than a second "
            "attempt, which seldom succeeds."
        ),
    )
    shard_size: int = Field(20, ge=1, le=1000, description="Samples per job.")
    sequences: Annotated[tuple[Annotated[str, Field(min_length=1)], ...], EachOnce()] = Field(
        (),
        description=(
            "Clips to take pieces of, by name; an empty list takes those of motions.sequences."
        ),
    )
    loop_frames: int = Field(
        150,
        ge=1,
        le=100_000,
        description=(
            "Length in frames at 30 fps that cyclic clips are repeated to, for pieces to begin "
            "anywhere in them."
        ),
    )
    frames: int = Field(60, ge=2, le=300, description="Frames of a sample at 30 fps.")
    frames_min: int = Field(
        40,
        ge=2,
        le=300,
        description=(
            "The least number of frames; samples of clips that are too short for `frames` have "
            "fewer."
        ),
    )
    speeds: tuple[_Speed, _Speed] = Field(
        (0.8, 1.2),
        description=(
            "The speed of each sample is drawn from this range; 1 is that of the recording."
        ),
    )
    mirror: bool = Field(
        True, description="Whether every other piece of a clip has left and right exchanged."
    )
    types: tuple[_Outfit, ...] = Field(
        EVEN_OUTFIT_TYPES,
        min_length=1,
        description=(
            "Outfits to take turns over; with this list, all types of garments are equally "
            "frequent."
        ),
    )
    edge_length_m: float = Field(
        0.02, ge=0.005, le=0.06, description="Mean edge length of the garments in metres."
    )
    val_share: float = Field(
        0.25,
        ge=0,
        le=0.5,
        description=(
            "Share of these samples for validation. Clips that are in the dataset keep their split."
        ),
    )
    test_share: float = Field(0.25, ge=0, le=0.5, description="Share of these samples for testing.")


class Static(Settings):
    """Outfits in the rest pose that the static networks are trained on."""

    count: int = Field(
        400, ge=3, le=1_000_000, description="Outfits to make, each on a body of its own."
    )
    shard_size: int = Field(100, ge=1, le=1000, description="Outfits per job.")
    edge_length_m: float = Field(
        0.02, ge=0.004, le=0.06, description="Mean edge length of these garments in metres."
    )
    settle_frames: int = Field(
        0,
        ge=0,
        le=300,
        description=(
            "Frames for which the fast cloth solver lets each outfit hang on its body before it "
            "is used; 30 give sleeves that hang down and skirts with folds, for two seconds of "
            "work each. 0 leaves garments as they are made."
        ),
    )
    val_share: float = Field(0.1, ge=0, le=0.9, description="Share of the outfits for validation.")
    test_share: float = Field(0.2, ge=0, le=0.9, description="Share of the outfits for testing.")


class Scans(Settings):
    """Scans of held-out samples that all models are fitted to, and how bodies are fitted to
    scans.
    """

    samples: ScanSettings = Field(ScanSettings(), description="How a sample is scanned.")
    learning: int = Field(
        12,
        ge=0,
        le=1000,
        description=(
            "How many samples of the learning group's test split are scanned too, from its clips "
            "in turn."
        ),
    )
    body: BodyFit = BodyFit()


class Renders(Settings):
    """Pictures of samples and in reports."""

    modality_frames: Annotated[tuple[Annotated[int, Field(ge=0, le=299)], ...], EachOnce()] = Field(
        (0,),
        description="Frames of each sample for RGB, depth, normals, velocities and segmentation.",
    )
    rays: float = Field(
        1,
        ge=0.005,
        le=10,
        description=(
            "Factor on the rays per pixel of the gallery and of rendered figures; fewer rays are "
            "faster and coarser, with blocks of pixels in one colour below 0.05."
        ),
    )


class Experiment(Settings):
    """All settings of an experiment. Units are part of the key names. Every key has a default,
    which a key takes that a config file omits; a key that is not listed here stops the run.

    Those of models are added by `experiment_with`.
    """

    results: str = Field(
        "results", min_length=1, description="Folder for everything this experiment makes."
    )
    seed: int = Field(1, ge=0, description="Seed of all random choices.")
    body: Body = Field(Body(), title="Bodies")
    motions: Motions = Field(Motions(), title="Motions")
    samples: Samples = Field(Samples(), title="Samples")
    outfits: Outfits = Field(Outfits(), title="Outfits")
    simulation: Simulation = Field(Simulation(), title="Simulation")
    registration: Registration = Field(Registration(), title="Registration to the body")
    learning: Learning = Field(Learning(), title="Learning group")
    static: Static = Field(Static(), title="Static outfits")
    scans: Scans = Field(Scans(), title="Segmented scans")
    renders: Renders = Field(Renders(), title="Pictures")


def experiment_with(models: Mapping[str, type[Settings]]) -> type[Experiment]:
    """The settings of an experiment with these models.

    Args:
        models: name of a model's block in a config -> its settings, whose `title`, if it has
            one, heads the block in the documentation.
    """
    blocks: dict[str, Any] = {name: (settings, settings()) for name, settings in models.items()}
    return create_model("Experiment", __base__=Experiment, __doc__=Experiment.__doc__, **blocks)
