"""What an experiment does with the garment VAEs."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import cached_property
from typing import Any

from drapeline.dataset.settings import CLEAN
from drapeline.errors import InputError
from drapeline.experiment.files import EVALUATED_SPLITS, ExperimentFiles
from drapeline.experiment.plan import ClipPiece, Wardrobe, plan_moving
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.generation.settings import BodySettings
from drapeline.models.gcvae.settings import (
    DVAE_VARIANTS,
    DYNAMIC_PPCA,
    MOVERS,
    PACKAGED_LATENT,
    PACKAGED_PPCA,
    PICTURES,
    SHORT_SVAES,
    SOLVER,
    STATIC_PPCA,
    SVAE_VARIANTS,
    WRINKLE_MLP,
    GcvaeSettings,
    dynamic_conditions,
    pooling_of,
)
from drapeline.models.pictures.plan import pictured_samples
from drapeline.models.registry import (
    PACKAGED,
    REPRESENTATIONS,
    SCAN_EVALUATIONS,
    SYSTEMS,
    EvaluationTask,
    Figure,
    Model,
    ModelPlan,
    Package,
    ReportFile,
    Task,
    figure,
    page,
)
from drapeline.models.training.settings import override_settings
from drapeline.motions.table import MotionEntry

_HERE = "drapeline.models.gcvae"
_ABLATIONS = "metrics_gcvae_ablations"
# Whose garments are measured: also some that were learned from, to tell what does not carry over.
_MEASURED_SPLITS = (*EVALUATED_SPLITS, "train")
# Evaluated by default, beside the trivial predictions.
_DEFAULT = {"svae", STATIC_PPCA, "dvae_unposed_4", DYNAMIC_PPCA, WRINKLE_MLP}


class _GcvaeTasks:
    """Tasks by kind, for the experiment with these files."""

    def __init__(self, files: ExperimentFiles) -> None:
        self.files, self.settings = files, files.config["gcvae"]
        self.folder, self.seed = f"{files.results}/gcvae", files.model_seed
        # The static model whose codes the dynamic ones are conditioned on.
        self.static = f"{self.folder}/{self.settings['dvae']['static_model']}"
        # The one that figures and samples are made with.
        self.shown = self.settings["sampling"]["variant"]

    def data(self) -> dict[str, Task]:
        """Pictures to learn codes from."""
        views = self.settings["pictures"]["views"]
        return {
            "data/pictures": Task(
                f"{_HERE}.pictures.data:collect",
                {
                    **self.files.bodies,
                    "data": self.files.static,
                    "outfits": self.files.outfits_at_rest,
                    "samples": self.files.per_shard(self.files.samples, self.files.moving),
                },
                {"settings": {**views, "seed": self.files.config["seed"]}},
                seconds=60 * self.files.static_size * views["per_outfit"],
                megabytes=1000 + 0.02 * views["size_px"] ** 2 * self.files.static_size,
                checks=self._check_pictures,
            )
        }

    @property
    def _check_pictures(self) -> list[Callable[[], None]]:
        splits = ("train", "val")
        return [self.files.resting_in(*splits), self.files.moving_in(*splits)]

    def trainings(self) -> dict[str, Task]:
        """Of conditionings, VAEs, PCA and what predicts wrinkles or codes of pictures."""
        return {
            "conditioning/static": self._conditioning_static(),
            **{name: self._svae(name) for name in SVAE_VARIANTS},
            STATIC_PPCA: self._static_ppca(self._ppca("svae")),
            PACKAGED_PPCA: self._static_ppca({**self._ppca("svae"), "latent": PACKAGED_LATENT}),
            **{
                f"conditioning/{version}_{frames}": self._conditioning_dynamic(version, frames)
                for version, frames in map(dynamic_conditions, DVAE_VARIANTS)
            },
            **{name: self._dvae(name) for name in DVAE_VARIANTS},
            DYNAMIC_PPCA: self._dynamic_ppca(),
            WRINKLE_MLP: self._wrinkle_mlp(),
            PICTURES: self._train_pictures(),
        }

    def _template(self, pooling: str = "segments") -> dict[str, str]:
        """What networks and PCA are laid over: bodies, topologies and mesh hierarchy."""
        return {
            **self.files.super_bodies,
            "topology": self.files.topology,
            "hierarchy": self.files.hierarchy(pooling),
        }

    def _conditioning(self, model: str) -> dict[str, Any]:
        """What the autoencoder of the svae's or the dvae's conditions is told."""
        return {
            "settings": {
                "condition": self.settings[model]["network"]["condition"],
                "training": {**self.settings["conditioning"], "seed": self.seed},
            },
            "trainer": {"accelerator": "cpu", "devices": 1},  # too small for anything else
        }

    def _conditioning_static(self) -> Task:
        return Task(
            f"{_HERE}.train:train_svae_conditioning",
            {"data": self.files.static},
            self._conditioning("svae"),
            seconds=6 * self.files.static_size + self._conditioning_seconds,
            megabytes=2000,
            checks=[self.files.resting_in("train", "val")],
        )

    def _conditioning_dynamic(self, version: str, frames: int) -> Task:
        return Task(
            f"{_HERE}.train:train_dvae_conditioning",
            {"data": self.files.dynamic(version), "static": self.static},
            {**self._conditioning("dvae"), "frames": frames},
            seconds=10 * self.files.moving_size + self._conditioning_seconds,
            megabytes=2000,
            checks=[self.files.moving_in("train", "val")],
        )

    @property
    def _conditioning_seconds(self) -> float:
        return 0.005 * self.settings["conditioning"]["steps"]

    def _vae(self, model: str, run: str, told: Mapping[str, Any], **given: Any) -> Task:
        """A training of the paper's svae or dvae, in one of its variants."""
        own = self.settings[model]
        width = own["network"]["widths"][0] / 8
        return Task(
            f"{_HERE}.train:{run}",
            given,
            {**told, "trainer": self.settings["trainer"]},
            seconds=0.025 * own["training"]["steps"] * own["training"]["batch"] * width,
            megabytes=500 + 60 * own["training"]["batch"] * width,
            checks=[
                (self.files.resting_in if model == "svae" else self.files.moving_in)("train", "val")
            ],
            parallel=True,
            gpus=self.files.gpus("gcvae"),
        )

    def _vae_settings(self, model: str, changes: Mapping[str, Any]) -> dict[str, Any]:
        own = self.settings[model]
        return override_settings(
            {
                "network": own["network"],
                "loss": self.settings["loss"],
                "training": {**own["training"], "seed": self.seed},
            },
            changes,
        )

    def _svae(self, name: str) -> Task:
        return self._vae(
            "svae",
            "train_svae",
            {"settings": self._vae_settings("svae", SVAE_VARIANTS[name])},
            **self._template(pooling_of(name)),
            data=self.files.static,
            conditioning=f"{self.folder}/conditioning/static",
        )

    def _dvae(self, name: str) -> Task:
        version, frames = dynamic_conditions(name)
        return self._vae(
            "dvae",
            "train_dvae",
            {"settings": self._vae_settings("dvae", DVAE_VARIANTS[name]), "frames": frames},
            **self._template(),
            data=self.files.dynamic(version),
            static=self.static,
            conditioning=f"{self.folder}/conditioning/{version}_{frames}",
        )

    def _ppca(self, model: str) -> dict[str, Any]:
        """Settings of the PCA that the svae or dvae is compared with: codes of the same size."""
        return {"latent": self.settings[model]["network"]["latent"], "seed": self.seed}

    def _static_ppca(self, settings: Mapping[str, Any]) -> Task:
        size = self.files.static_size
        return Task(
            f"{_HERE}.train:fit_static_ppca",
            {**self._template(), "data": self.files.static},
            {"settings": settings},
            seconds=40 * size,
            megabytes=2000 + 300 * size,
            checks=[self.files.resting_in("train", "val")],
            parallel=True,
        )

    def _dynamic_ppca(self) -> Task:
        version, frames = dynamic_conditions(DYNAMIC_PPCA)
        size = self.files.moving_size
        return Task(
            f"{_HERE}.train:fit_dynamic_ppca",
            {**self._template(), "data": self.files.dynamic(version), "static": self.static},
            {"settings": self._ppca("dvae"), "frames": frames},
            seconds=90 * size,
            megabytes=3000 + 100 * size,
            checks=[self.files.moving_in("train", "val")],
            parallel=True,
        )

    def _wrinkle_mlp(self) -> Task:
        version, frames = dynamic_conditions(WRINKLE_MLP)
        own, size = self.settings["mlp"], self.files.moving_size
        training = {**own["training"], "seed": self.seed}
        return Task(
            f"{_HERE}.train:train_wrinkle_mlp",
            {**self._template(), "data": self.files.dynamic(version), "static": self.static},
            {
                "settings": {**own, "training": training, **self._ppca("dvae")},
                "frames": frames,
                "trainer": {"accelerator": "cpu", "devices": 1},  # too small for anything else
            },
            seconds=100 * size + 2e-5 * training["steps"] * training["batch"],
            megabytes=3000 + 100 * size,
            checks=[self.files.moving_in("train", "val")],
            parallel=True,
        )

    def _train_pictures(self) -> Task:
        own = self.settings["pictures"]
        training = {**own["training"], "seed": self.seed}
        return Task(
            f"{_HERE}.pictures.train:train",
            {
                "model": f"{self.folder}/{self.shown}",
                "data": self.files.static,
                "pictures": f"{self.folder}/data/pictures",
            },
            {
                "settings": {"width": own["width"], "training": training},
                "trainer": self.settings["trainer"],
            },
            seconds=0.004 * training["steps"] * training["batch"],
            megabytes=1500,
            checks=self._check_pictures,
            parallel=True,
            gpus=self.files.gpus("gcvae"),
        )

    def evaluations(self) -> dict[str, EvaluationTask]:
        """Of trivial predictions and trained models, and the comparisons with other models."""
        always = ("metrics", _ABLATIONS)
        found: dict[str, tuple[Task, Sequence[str]]] = {
            "baselines": (self._baselines(), (*always, PACKAGED)),
            "dynamic_baselines": (self._dynamic_baselines(), always),
        }
        for names, task in (
            ((*SVAE_VARIANTS, STATIC_PPCA), self._evaluate_static),
            ((*DVAE_VARIANTS, DYNAMIC_PPCA, WRINKLE_MLP), self._evaluate_dynamic),
        ):
            for name in names:
                found[name] = (task(name), always if name in _DEFAULT else (_ABLATIONS,))
        found[PACKAGED_PPCA] = (self._evaluate_static(PACKAGED_PPCA), (PACKAGED,))
        if self.simulated_again:
            found["dynamic_floor"] = (self._floor(), always)
        if self.pictured:
            found["pictures"] = (self._find_in_pictures(), (*always, SYSTEMS))
        found["representations"] = (self._compare(), (REPRESENTATIONS, SYSTEMS))
        found["other_codes"] = (self._compare_other_codes(), (SYSTEMS,))
        if self.files.scanned:
            found |= {
                evaluation: (self._fit_scans(kind), (table,))
                for evaluation, (kind, table) in SCAN_EVALUATIONS.items()
            }
            found["moved"] = (self._move(), (SYSTEMS,))
            found["moved_again"] = (self._move_again(), (SYSTEMS,))
        return {f"evaluated/{name}": EvaluationTask(*one) for name, one in found.items()}

    def _baselines(self) -> Task:
        size = self.files.static_size
        return Task(
            f"{_HERE}.evaluate:evaluate_baselines",
            {**self.files.super_bodies, "topology": self.files.topology, "data": self.files.static},
            {
                "splits": _MEASURED_SPLITS,
                "components": self.settings["evaluation"]["pca_components"],
                "seed": self.seed,
            },
            seconds=60 * size,
            megabytes=700 + 600 * size,
            parallel=True,
        )

    def _dynamic_baselines(self) -> Task:
        # The data and the conditions of masked PCA.
        version, frames = dynamic_conditions(DYNAMIC_PPCA)
        size = self.files.moving_size
        return Task(
            f"{_HERE}.evaluate:evaluate_dynamic_baselines",
            {
                **self.files.registered_samples,
                **self.files.super_bodies,
                "topology": self.files.topology,
                "data": self.files.dynamic(version),
                "static": self.static,
            },
            {
                "splits": _MEASURED_SPLITS,
                "frames": frames,
                "components": self.settings["evaluation"]["pca_components"],
                "seed": self.seed,
            },
            seconds=120 * size,
            megabytes=3500 + 100 * size,
            checks=[self.files.moving_in("train", "val")],
            parallel=True,
        )

    @cached_property
    def simulated_again(self) -> list[str]:
        """Test samples, to tell how far they are from themselves then."""
        count = self.settings["evaluation"]["floor_samples"]
        return self.files.first_of_split(count, EVALUATED_SPLITS[0])

    @cached_property
    def _told_of_pictures(self) -> dict[str, Any]:
        """What an evaluation is told of pictures; see `pictured_samples`."""
        return pictured_samples(self.files)

    @property
    def pictured(self) -> list[str]:
        """Held-out samples that pictures are taken of."""
        return self._told_of_pictures["samples"] + self._told_of_pictures["others"]

    def _find_in_pictures(self) -> Task:
        files, samples = self.files, self.pictured
        return Task(
            f"{_HERE}.pictures.evaluate:evaluate",
            {
                **files.bodies,
                "network": f"{self.folder}/{PICTURES}",
                "model": f"{self.folder}/{self.shown}",
                "data": files.static,
                "pictures": f"{self.folder}/data/pictures",
                "samples": files.shards_of(files.samples, samples),
                "registrations": files.shards_of(files.registrations, samples),
            },
            {**self._told_of_pictures, "seed": self.seed},
            seconds=60 + 10 * len(samples),
            megabytes=1500,
        )

    def _floor(self) -> Task:
        samples, files = self.simulated_again, self.files
        super_bodies = {f"super_{gender}": path for gender, path in files.super_bodies.items()}
        return Task(
            f"{_HERE}.floor:evaluate_floor",
            {
                **files.bodies,
                **super_bodies,
                "topology": files.topology,
                "samples": files.shards_of(files.samples, samples),
                "registrations": files.shards_of(files.registrations, samples),
                "outfits": files.shards_of(files.outfits, samples),
                "motions": files.shards_of(files.moving_bodies, samples),
            },
            {
                "solver": files.hanging_solver,
                "samples": samples,
                "split": EVALUATED_SPLITS[0],
                "step": self.settings["dvae"]["frame_step"],
                "seed": self.seed,
            },
            seconds=20 * len(samples),
            megabytes=1500,
            modules=[files.hanging_solver],
        )

    def _evaluate_static(self, name: str) -> Task:
        size = self.files.static_size
        return Task(
            f"{_HERE}.evaluate:evaluate_static",
            {"model": f"{self.folder}/{name}", "data": self.files.static},
            {"variant": name, "splits": _MEASURED_SPLITS},
            seconds=44 * size,
            megabytes=700 + 100 * size,
            parallel=True,
        )

    def _evaluate_dynamic(self, name: str) -> Task:
        version, frames = dynamic_conditions(name)
        size = self.files.moving_size
        return Task(
            f"{_HERE}.evaluate:evaluate_dynamic",
            {
                **self.files.registered_samples,
                **self.files.super_bodies,
                "topology": self.files.topology,
                "model": f"{self.folder}/{name}",
                "data": self.files.dynamic(version),
                "static": self.static,
            },
            {"variant": name, "splits": _MEASURED_SPLITS, "frames": frames},
            seconds=130 * size,
            megabytes=800 + 50 * size,
            parallel=True,
        )

    def _static_models(self) -> list[str]:
        return [f"{self.folder}/svae", f"{self.folder}/{STATIC_PPCA}"]

    def _compare(self) -> Task:
        return Task(
            f"{_HERE}.evaluate:compare_codes",
            {
                "models": self._static_models(),
                "data": self.files.static,
                "outfits": self.files.outfits_at_rest,
            },
            {
                "components": self.settings["evaluation"]["pca_components"],
                **self.files.compared,
            },
            seconds=1800,
            megabytes=2500,
            checks=[self.files.resting_in(*EVALUATED_SPLITS)],
        )

    def _compare_other_codes(self) -> Task:
        task, models = self._compare(), [f"{self.folder}/{name}" for name in SHORT_SVAES]
        run = f"{_HERE}.evaluate:compare_other_codes"
        return task._replace(
            run=run, input={**task.input, "models": models}, params=self.files.compared
        )

    def _fit_scans(self, kind: str) -> Task:
        return Task(
            f"{_HERE}.evaluate:fit_codes_to_scans",
            {**self.files.bodies, **self.files.known_scans(kind), "models": self._static_models()},
            {"kind": kind, **self.files.compared},
            seconds=4800,
            megabytes=2500,
        )

    def _move(self) -> Task:
        version, _ = dynamic_conditions(WRINKLE_MLP)
        moving = ("dvae_unposed_4", DYNAMIC_PPCA, WRINKLE_MLP)
        return Task(
            f"{_HERE}.evaluate:move_garments_at_rest",
            {
                **self.files.bodies,
                **self.files.known_scans(CLEAN),
                "models": [f"{self.folder}/{name}" for name in moving],
                "static": self.static,
                "data": self.files.dynamic(version),
            },
            self.files.compared,
            seconds=1200,
            megabytes=2500,
        )

    def _move_again(self) -> Task:
        files = self.files
        return Task(
            f"{_HERE}.floor:move_garments_again",
            {
                **files.bodies,
                **files.known_scans(CLEAN),
                "outfits": files.shards_of(files.outfits, files.scanned),
                "motions": files.shards_of(files.moving_bodies, files.scanned),
            },
            {"solver": files.hanging_solver, **files.compared},
            seconds=60 + 20 * len(files.scanned),
            megabytes=1500,
            modules=[files.hanging_solver],
        )

    def packages(self) -> dict[str, Package]:
        """The linear model of garments at rest, which is the better one."""
        return {
            "gcvae": Package(
                f"{self.folder}/{PACKAGED_PPCA}",
                f"Garments at rest as codes of {PACKAGED_LATENT} numbers, to be sampled, encoded"
                " and decoded",
                'skirts = model.sample(8, "Skirt", gender="female", seed=1)',
                ("ppca", "baseline"),
                (PACKAGED_PPCA, "pca", "mean_garment", "nearest_cvar"),
                ("surface_error_mm", "normal_error_deg", "mask_iou"),
                tuple(self.files.types_at_rest("train")),
            )
        }

    def samples(self) -> dict[str, Task]:
        """Garments of codes that are drawn."""
        asked, config = self.settings["sampling"], self.files.config
        keys = ("count", "female_share", "shape", "tightness")
        return {
            "sampled": Task(
                f"{_HERE}.sample:sample_garments_of_codes",
                {**self.files.bodies, "model": f"{self.folder}/{self.shown}"},
                {
                    "seed": self.seed,
                    "conditions": {
                        **{key: asked[key] for key in keys},
                        "garments": asked["garments"] or self.files.types_at_rest("train"),
                        "shape_range": config["body"]["shape_range"],
                        "tightness_range": config["outfits"]["tightness_range"],
                    },
                    "settle": asked["settle"],
                    "hang_frames": asked["hang_frames"],
                    **self.files.hanging,
                },
                seconds=600 + 20 * asked["count"],
                megabytes=2000,
                modules=[self.files.hanging_solver],
            ),
            "animated": self._animate(),
        }

    def _animate(self) -> Task:
        asked, sampling, config = (
            self.settings["animation"],
            self.settings["sampling"],
            self.files.config,
        )
        clip: MotionEntry | None = None
        plans: list[SamplePlan] = []
        with suppress(InputError):  # is raised again where the task is wanted
            clip, plans = self._plan_outfits()
        learned = {name: MOVERS[name] for name in asked["movers"] if name != SOLVER}
        return Task(
            f"{_HERE}.animate:animate_outfits",
            {
                **self.files.bodies,
                "model": f"{self.folder}/{self.shown}",
                "static": self.static,
                "motion": self.files.motion(clip) if clip else [],
                **{name: f"{self.folder}/{variant}" for name, variant in learned.items()},
            },
            {
                "seed": self.seed,
                "plans": [asdict(plan) for plan in plans],
                "bodies": {key: config["body"][key] for key in BodySettings.model_fields},
                "tightness": sampling["tightness"],
                "tightness_range": config["outfits"]["tightness_range"],
                "movers": asked["movers"],
                "settle": sampling["settle"],
                "hang_frames": sampling["hang_frames"],
                **self.files.hanging,
            },
            seconds=60 + asked["count"] * asked["frames"],
            megabytes=2500,
            checks=[self._check_outfits],
            modules=[self.files.hanging_solver],
        )

    def _check_outfits(self) -> None:
        self._plan_outfits()

    def _plan_outfits(self) -> tuple[MotionEntry, list[SamplePlan]]:
        """The clip of the animation, and who wears what in it.

        Raises:
            InputError: there is no such clip, no model learns a garment, or male bodies are left
                with nothing to wear.
        """
        asked, config = self.settings["animation"], self.files.config
        moving = self.files.moving_plans.values()
        moved = {plan.sequence for plan in moving}
        clips = {
            name: clip
            for group in self.files.moving
            for name, clip in group.clips.items()
            if name in moved
        }
        chosen = asked["clip"] or next(
            (
                plan.sequence
                for split in ("test", "val", "train")
                for plan in moving
                if plan.split == split
            ),
            "",
        )
        if chosen not in clips:
            raise InputError(
                f"gcvae.animation.clip: '{chosen}', expected one of {', '.join(clips) or 'none'}"
            )
        piece = next(plan for plan in moving if plan.sequence == chosen)
        worn = [plan.outfit_type for plan in self.files.resting_plans.values()]
        types = asked["types"] or list(dict.fromkeys(worn))
        known = self.files.types_at_rest("train")
        for garment in (name for worn in types for name in worn.split("+")):
            if garment not in known:
                raise InputError(
                    f"gcvae.animation.types: {garment}, expected garments of the outfits at rest:"
                    f" {', '.join(known)}"
                )
        frames = min(asked["frames"], clips[chosen].frames - piece.start)
        cut = ClipPiece(chosen, piece.part, piece.start, piece.start + frames)
        wardrobe = Wardrobe(config["body"]["female_share"], types, config["outfits"]["male_skirts"])
        plans = plan_moving(asked["count"], "drawn", lambda *_: cut, {chosen: "test"}, wardrobe)
        return clips[chosen], plans

    def figures(self) -> dict[str, Figure]:
        """Tables 3 and 4 of the paper, figures 7 to 10, and samples."""
        bodies, evaluated = self.files.bodies, f"{self.folder}/evaluated"
        model, codes = f"{self.folder}/{self.shown}", f"{evaluated}/{self.shown}"
        moving = {
            **self.files.registered_samples,
            **{f"super_{gender}": path for gender, path in self.files.super_bodies.items()},
            **bodies,
            "topology": self.files.topology,
            "dvae": f"{self.folder}/{DYNAMIC_PPCA}",
            "dynamic": self.files.dynamic(dynamic_conditions(DYNAMIC_PPCA)[0]),
            "static": self.static,
        }
        frames = dynamic_conditions(DYNAMIC_PPCA)[1]
        rays = {"rays": self.files.config["renders"]["rays"]}
        return {
            "tabulate_gcvae": self._tables("metrics", "gcvae_metrics"),
            "tabulate_gcvae_ablations": self._tables(_ABLATIONS, "gcvae_ablations", default=False),
            "plot_gcvae_samples": figure(
                f"{_HERE}.figures:plot_sampled",
                {**bodies, "samples": f"{self.folder}/sampled"},
                {"shown": 24, **rays},
                picture=ReportFile("gcvae_samples.png", "sampled garments", "gcvae_samples"),
            ),
            **{
                f"plot_gcvae_codes_{name}": figure(
                    f"{_HERE}.figures:plot_evaluated_codes",
                    {"evaluated": f"{evaluated}/{name}"},
                    {},
                    picture=ReportFile(
                        f"gcvae_codes_{name}.png",
                        f"figure 8: codes of static garments ({name})",
                        "gcvae_codes",
                    ),
                )
                for name in ("svae", STATIC_PPCA)
            },
            "plot_gcvae_walks": figure(
                f"{_HERE}.figures:plot_walks",
                {**bodies, "model": model, "evaluated": codes, "data": self.files.static},
                {"steps": 7, "frames": 24, **rays},
                sheet=ReportFile("gcvae_walks.png", "figure 9: transitions", "gcvae_walks"),
                moving=ReportFile(
                    "gcvae_walk_moving.png", "figure 9: a transition in motion", "gcvae_walks"
                ),
            ),
            "plot_gcvae_errors": figure(
                f"{_HERE}.figures:plot_errors",
                {
                    **moving,
                    "svae": model,
                    "evaluated": codes,
                    "data": self.files.static,
                    "outfits": self.files.outfits_at_rest,
                },
                {"frames": frames, **rays},
                checks=[self.files.resting_in(*EVALUATED_SPLITS)],
                picture=ReportFile(
                    "gcvae_errors.png", "figure 7: reconstructions and their errors", "gcvae_errors"
                ),
            ),
            **({"plot_gcvae_pictures": self._plot_pictures()} if self.pictured else {}),
            **({"show_gcvae_animated": self._show_animated()} if self._animated_pages() else {}),
            "compare_gcvae_samples": figure(
                f"{_HERE}.likeness:compare_with_real",
                {
                    **bodies,
                    "samples": f"{self.folder}/sampled",
                    "model": model,
                    "data": self.files.static,
                    "outfits": self.files.outfits_at_rest,
                },
                {
                    "seed": self.seed,
                    "split": EVALUATED_SPLITS[0],
                    "hang_frames": self.settings["sampling"]["hang_frames"],
                    **self.files.hanging,
                },
                checks=[self.files.resting_in(*EVALUATED_SPLITS)],
                modules=[self.files.hanging_solver],
                default=False,
                page=ReportFile(
                    "gcvae_likeness.html", "sampled garments beside real ones", "gcvae_likeness"
                ),
                table="gcvae_likeness.tsv",
            ),
            "plot_gcvae_wrinkles": figure(
                f"{_HERE}.figures:plot_wrinkles",
                moving,
                {"frames": frames, "columns": 6, "seed": self.seed, **rays},
                picture=ReportFile(
                    "gcvae_wrinkles.png", "figure 10: wrinkle codes elsewhere", "gcvae_wrinkles"
                ),
            ),
        }

    def _plot_pictures(self) -> Figure:
        return figure(
            "drapeline.report.models.gcvae.pictures:plot_evaluated",
            {
                "evaluated": f"{self.folder}/evaluated/{PICTURES}",
                # The same pictures, as SMPLicit's fit sees them.
                "fitted": f"{self.files.results}/smplicit/evaluated/images",
            },
            {"most": 8, "rays": self.files.config["renders"]["rays"]},
            environment="report",
            picture=ReportFile(
                "gcvae_pictures.png", "figure 11: garments from pictures", "gcvae_pictures"
            ),
        )

    def _show_animated(self) -> Figure:
        pages = self._animated_pages()
        return figure(
            f"{_HERE}.animate:show_animated",
            {"animated": f"{self.folder}/animated"},
            {"names": list(pages)},
            checks=[self._check_outfits],
            default=False,
        )._replace(output=pages)

    def _animated_pages(self) -> dict[str, ReportFile]:
        """A page for each outfit in motion."""
        return {
            plan["sample"]: ReportFile(
                f"gcvae_animated_{plan['sample']}.html",
                f"a sampled outfit in motion ({plan['sample']})",
                "gcvae_animated",
            )
            for plan in self._animate().params["plans"]
        }

    def _tables(self, table: str, name: str, *, default: bool = True) -> Figure:
        return page(
            "drapeline.report.models.gcvae.tables:tabulate",
            {"metrics": self.files.metrics(table)},
            {},
            default=default,
            page=ReportFile(f"{name}.html", f"tables 3 and 4 ({table})", "gcvae_tables"),
            table=f"{name}_beside_paper.tsv",
        )

    def targets(self) -> dict[str, list[str]]:
        """Every row of tables 3a and 4; and new garments."""
        report = f"{self.files.results}/report"
        return {
            "sample_garments": [f"{self.folder}/sampled"],
            "compare_sampled": [f"{report}/gcvae_likeness.html"],
            "animate_sampled": [
                f"{self.folder}/animated",
                *(f"{report}/{page.file}" for page in self._animated_pages().values()),
            ],
            "gcvae_ablations": [self.files.metrics(_ABLATIONS), f"{report}/gcvae_ablations.html"],
        }


def _plan(files: ExperimentFiles) -> ModelPlan:
    tasks = _GcvaeTasks(files)
    return ModelPlan(
        data=tasks.data(),
        trainings=tasks.trainings(),
        evaluations=tasks.evaluations(),
        samples=tasks.samples(),
        figures=tasks.figures(),
        targets=tasks.targets(),
        packages=tasks.packages(),
    )


MODEL = Model(
    "gcvae",
    "Garment VAE",
    GcvaeSettings,
    _plan,
    loaders={name: f"{_HERE}.static_model:StaticModel" for name in ("static", "static_ppca")},
)
