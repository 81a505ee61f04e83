"""The whole config: the settings of all rooms, and of the models.

Room by room they are declared beside what they are for; here they get their place in a config.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import create_model

from drapeline.bodies.settings import BodyFit
from drapeline.dataset.settings import ScanSettings
from drapeline.experiment.cloth_solvers import CLOTH_SOLVERS
from drapeline.frames import GENDERS
from drapeline.generation.settings import BodySettings, OutfitSettings
from drapeline.outfits.garment_types import (
    CLOTH3D_OUTFITS,
    EVEN_OUTFIT_TYPES,
    GARMENTS,
    OUTFIT_TYPES,
)
from drapeline.outfits.settings import OwnGarmentFiles
from drapeline.settings import ConfigDict, EachOnce, Field, OneOf, Settings
from drapeline.simulation.settings import HealthBounds, SimulationSettings

_Solver = Annotated[str, OneOf(tuple(CLOTH_SOLVERS))]
# Without one, garments stay at rest.
_GroupSolver = Annotated[str, OneOf((*CLOTH_SOLVERS, "none"))]
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
    folder: Annotated[str, Field(min_length=1)] | None = Field(
        None,
        description=(
            "Where the files of the table are that do not lie beside it; without a folder, clips "
            "that the table calls optional may be missing."
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
    anywhere: bool = Field(
        False,
        description=(
            "Whether a piece begins anywhere in its clip; without it, clips are cut into pieces "
            "one after another."
        ),
    )
    speeds: tuple[_Speed, _Speed] = Field(
        (1, 1),
        description=(
            "The speed of each piece that begins anywhere is drawn from this range; 1 is that of "
            "the recording."
        ),
    )
    mirror: bool = Field(
        False,
        description=(
            "Whether every other piece of a clip that begins anywhere has left and right exchanged."
        ),
    )
    lock_feet: bool = Field(
        True,
        description=(
            "Bend the legs of BVH and AMC motions so that resting feet neither slide nor float."
        ),
    )


class Outfits(OutfitSettings):
    """What bodies wear."""

    types: tuple[_Outfit, ...] = Field(
        CLOTH3D_OUTFITS,
        min_length=1,
        description="Outfits to take turns over; one that is listed twice gets two turns.",
    )
    male_skirts: bool = Field(
        False, description="Whether male bodies also wear skirts and dresses."
    )
    hang_frames: int = Field(
        0,
        ge=0,
        le=300,
        description=(
            "Frames for which the fast cloth solver lets each outfit of a group at rest hang on "
            "its body before it is used; 30 give sleeves that hang down and skirts with folds, for "
            "two seconds of work each. 0 leaves garments as they are made."
        ),
    )
    own_garments: dict[Annotated[str, OneOf(GARMENTS)], _Path | OwnGarmentFiles] = Field(
        {},
        strict=False,
        description="Your own OBJ files, aligned with the rest body, to use instead of a template.",
    )


class Simulation(Settings):
    """Cloth that moves."""

    solver: _Solver = Field(
        "blender",
        description=(
            "The cloth solver that moves the garments. `blender` is the reference; `xpbd`, ours, "
            "is about five times as fast."
        ),
    )
    accelerator: Literal["cpu", "gpu", "auto"] = Field(
        "cpu",
        description=(
            "What the fast cloth solver works on, for groups that it moves and for outfits that "
            "hang. `auto` takes a GPU where there is one. Jobs take turns on a GPU, so it "
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


class Overrides(Settings):
    """Settings that a group has of its own; what is None holds as it does for all."""

    model_config = ConfigDict(json_schema_extra={"overrides": True})


def _overrides(place: str, common: type[Settings], *but: str) -> Any:
    """Settings that a group may have of its own.

    Args:
        place: of the common ones in a config.
        common: their class.
        but: those that no group has of its own.
    """
    fields: dict[str, Any] = {
        name: (field.rebuild_annotation() | None, Field(None, description=field.description))
        for name, field in common.model_fields.items()
        if name not in but
    }
    about = f"Settings of `{place}` that differ here."
    return create_model(f"Own{common.__name__}", __base__=Overrides, __doc__=about, **fields)


OwnMotions = _overrides("motions", Motions, "table", "folder", "lock_feet")
OwnOutfits = _overrides("outfits", Outfits)
OwnSimulation = _overrides("simulation.settings", SimulationSettings)


_ModelName = Annotated[str, Field(min_length=1)]


class Group(Settings):
    """Samples that are made alike."""

    count: Annotated[int, Field(ge=0, le=1_000_000)] | None = Field(
        None,
        description=(
            "Samples to make, taking turns over the clips; 0 leaves the group out, null makes one "
            "of each sub-sequence."
        ),
    )
    shard_size: int = Field(
        20, ge=1, le=1000, description="Samples per job of each step. The samples are the same."
    )
    solver: _GroupSolver | None = Field(
        None,
        description=(
            "The cloth solver that moves the garments; null takes simulation.solver. With none, "
            "they stay at rest on bodies at rest, as static networks learn them."
        ),
    )
    val_share: float = Field(
        0.1,
        ge=0,
        le=0.9,
        description=(
            "Share of the samples for validation. A clip is in one split, that of the first group "
            "that has it."
        ),
    )
    test_share: float = Field(0.2, ge=0, le=0.9, description="Share of the samples for testing.")
    prefix: Annotated[str, Field(pattern="^([A-Za-z0-9_]*[A-Za-z_])?$")] | None = Field(
        None,
        description=(
            "What ids of samples begin with, before their number; null takes the name of the group."
        ),
    )
    learned_by: Annotated[tuple[_ModelName, ...], EachOnce()] | None = Field(
        None,
        description=(
            "Models that learn from the samples and are tested on them, such as [garment4d]; null "
            "means all."
        ),
    )
    published: bool = Field(
        False,
        description="Whether the samples are part of the dataset and have pictures of their own.",
    )
    # No class is written for these: they have the fields of others.
    motions: OwnMotions = OwnMotions()  # type: ignore[valid-type]
    outfits: OwnOutfits = OwnOutfits()  # type: ignore[valid-type]
    simulation: OwnSimulation = OwnSimulation()  # type: ignore[valid-type]


class Groups(Settings):
    """Samples that are made alike: those that come along, and any that a config adds by name. All
    go through everything that samples go through.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Group]

    dataset: Group = Field(
        Group(shard_size=1, prefix="", published=True), description="Samples that are published."
    )
    learning: Group = Field(
        Group(
            count=0,
            solver="xpbd",
            val_share=0.25,
            test_share=0.25,
            prefix="L",
            motions=OwnMotions(
                loop_frames=150,
                frames=60,
                frames_min=40,
                anywhere=True,
                speeds=(0.8, 1.2),
                mirror=True,
            ),
            outfits=OwnOutfits(types=EVEN_OUTFIT_TYPES, edge_length_m=0.02, vertices_min=0),
            # Another sample takes less time than a second attempt, which seldom succeeds.
            simulation=OwnSimulation(attempts=1),
        ),
        description=(
            "More simulated samples, with bodies, outfits and pieces of clips of their own, that "
            "networks learn from and are tested on."
        ),
    )
    static: Group = Field(
        Group(
            count=400,
            shard_size=100,
            solver="none",
            prefix="s",
            outfits=OwnOutfits(
                types=EVEN_OUTFIT_TYPES, edge_length_m=0.02, vertices_min=0, own_garments={}
            ),
        ),
        description="Outfits at rest that static networks are trained on.",
    )


class Scans(Settings):
    """Scans of held-out samples that all models are fitted to, and how bodies are fitted to
    scans.
    """

    noisy: ScanSettings = Field(
        ScanSettings(), description="Single frames, from all around, of a body that is estimated."
    )
    clean: ScanSettings = Field(
        ScanSettings(window=31, points=8000, noise_m=0, pose_rad=0, place_m=0, joints_m=0, shape=0),
        description="Exact points of a body that is known; for `compare_systems`.",
    )
    worse: ScanSettings = Field(
        ScanSettings(
            window=31,
            points=8000,
            noise_m=0.01,
            visibility="single",
            missing=0.3,
            pose_rad=0.05,
            place_m=0.02,
            shape=0.5,
        ),
        description=(
            "What one camera sees, with noise and holes, of a body that is estimated; for "
            "`compare_systems`."
        ),
    )
    count: int = Field(
        12,
        ge=0,
        le=1_000_000,
        description=(
            "Samples of the test split of each group that are scanned, the first ones, which take "
            "turns over its clips."
        ),
    )
    body: BodyFit = BodyFit()


class Renders(Settings):
    """Pictures of samples and in reports."""

    modality_frames: Annotated[tuple[Annotated[int, Field(ge=0, le=299)], ...], EachOnce()] = Field(
        (0,),
        description=(
            "Frames of each sample for RGB, depth, normals, velocities, optical flow, segments and "
            "keypoints."
        ),
    )
    cameras: int = Field(
        1,
        ge=1,
        le=36,
        description=(
            "Cameras that take these, at equal angles around the person; the first stands where "
            "CLOTH3D's does."
        ),
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


class Release(Settings):
    """The dataset as it is published by `snakemake release`."""

    name: str = Field(
        "clothed-humans-in-motion", min_length=1, description="Of the dataset, for machines."
    )
    creator: str = Field("drapeline", min_length=1, description="Who publishes it.")
    version: str = Field("1.0.0", min_length=1, description="Of the dataset.")


class Experiment(Settings):
    """All settings of an experiment. Units are part of the key names. Every key has a default,
    which a key takes that a config file omits; a key that is not listed here stops the run.

    Those of models are added by `experiment_with`.
    """

    results: str = Field(
        "results", min_length=1, description="Folder for everything this experiment makes."
    )
    seed: int = Field(1, ge=0, description="Seed of all random choices.")
    model_seed: int | None = Field(
        None,
        ge=0,
        description=(
            "Seed of trainings and evaluations, to train once more on the same samples; by default "
            "`seed`."
        ),
    )
    init: Literal["random", "package"] = Field(
        "random",
        description=(
            "What networks begin with: random weights, or those of the models that come with "
            "drapeline, where these have learned from nothing that is held out here."
        ),
    )
    body: Body = Field(Body(), title="Bodies")
    motions: Motions = Field(Motions(), title="Motions")
    outfits: Outfits = Field(Outfits(), title="Outfits")
    simulation: Simulation = Field(Simulation(), title="Simulation")
    groups: Groups = Field(Groups(), title="Groups of samples")
    registration: Registration = Field(Registration(), title="Registration to the body")
    scans: Scans = Field(Scans(), title="Segmented scans")
    renders: Renders = Field(Renders(), title="Pictures")
    release: Release = Field(Release(), title="Release")
    predictions: str | None = Field(
        None,
        min_length=1,
        description=(
            "Folder of meshes by which another method answers the cases of `snakemake protocol`; "
            "its name is the method's."
        ),
    )


def experiment_with(models: Mapping[str, type[Settings]]) -> type[Experiment]:
    """The settings of an experiment with these models.

    Args:
        models: name of a model's block in a config -> its settings, whose `title`, if it has
            one, heads the block in the documentation.
    """
    blocks: dict[str, Any] = {name: (settings, settings()) for name, settings in models.items()}
    return create_model("Experiment", __base__=Experiment, __doc__=Experiment.__doc__, **blocks)
