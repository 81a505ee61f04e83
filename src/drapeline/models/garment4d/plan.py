"""What an experiment does with Garment4D."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, TypeVar

from drapeline.dataset.settings import CLEAN
from drapeline.experiment.checks import planned_sequences, require_sequences, require_simulated
from drapeline.experiment.cloth_solvers import OUR_SOLVER
from drapeline.experiment.files import EVALUATED_SPLITS, ExperimentFiles
from drapeline.models.garment4d.settings import (
    MGN_VARIANTS,
    PAPER_FRAMES,
    RELEASED_INTERPENETRATION,
    Garment4dSettings,
    posed_variants,
)
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
from drapeline.models.start import start_of
from drapeline.models.training.settings import override_settings
from drapeline.outfits.garment_types import GARMENTS

_HERE = "drapeline.models.garment4d"
_SOURCES = "drapeline.learning_data.sequence_sources"
_PAGES = "drapeline.report.models.garment4d"
_ABLATIONS = "metrics_garment4d_ablations"
_PULLED_MGN = "mgn_pulled"
_Worn = TypeVar("_Worn", bound=Hashable)
_PRINTED_PASSES = 100  # that smooth skinning weights
_AGAIN = 20  # test samples of each group that are simulated again, at most
PROTOCOLS = ("surface", "vertices")


class Garment4dFiles:
    """Files that Garment4D has of its own, by what they hold.

    Patterns have `{group}` and `{shard}`.
    """

    def __init__(self, files: ExperimentFiles) -> None:
        self._files = files
        self.settings = files.config["garment4d"]
        self.folder = f"{files.results}/garment4d"
        # Garment types that models are compared on, one network of each stage for each type.
        self.garments = self.settings["garments"]
        self.labelled = f"{self.folder}/labelled"
        self.skinned = f"{self.folder}/skinned/{{group}}/{{shard}}"
        # Shards of outfits at rest that the networks learn from besides simulated samples.
        shards = [(group.name, shard) for group in files.resting for shard in group.shards]
        self.skinned_shards = shards[: self.settings["skinned"]["shards"]]

    def template(self, garment: str) -> str:
        """That garments of a type are registered to."""
        return f"{self.folder}/{garment}/template.npz"

    def fits(self, garment: str) -> str:
        """Pattern of a type's template fitted to garments."""
        return f"{self.folder}/{garment}/fits/{{group}}/{{shard}}"

    def sequences(self, garment: str) -> str:
        """Sequences of a type, sampled as the config says."""
        return f"{self.folder}/{garment}/data_{self.settings['protocol']}"

    @cached_property
    def wearers(self) -> dict[str, list[str]]:
        """Type -> samples in motion that wear it."""
        plans = self._files.moving_plans.items()
        return _by_garment((sample, plan.outfit_type) for sample, plan in plans)

    @cached_property
    def skinned_wearers(self) -> dict[str, list[tuple[str, str]]]:
        """Type -> those of `skinned_shards` that have it."""
        return _by_garment(
            ((group, shard), plan.outfit_type)
            for group, shard in self.skinned_shards
            for plan in self._files.groups[group].shards[shard]
        )

    def clouds(self, protocol: str) -> str:
        """Pattern of point clouds of samples."""
        return f"{self.folder}/clouds_{protocol}/{{group}}/{{shard}}"

    def learnt_fits(self, garment: str) -> list[str]:
        """A template fitted to all garments that models learn from or are tested on."""
        fits = self.fits(garment)
        skinned = [
            fits.format(group=group, shard=shard) for group, shard in self.skinned_wearers[garment]
        ]
        return [*skinned, *self._files.shards_of(fits, self.wearers[garment])]


def _by_garment(worn: Iterable[tuple[_Worn, str]]) -> dict[str, list[_Worn]]:
    """Garment type -> what wears it, each once, of pairs with types of outfits."""
    found: dict[str, dict[_Worn, None]] = {name: {} for name in GARMENTS}
    for wearer, outfit_type in worn:
        for name in outfit_type.split("+"):
            found[name][wearer] = None
    return {name: [*wearers] for name, wearers in found.items()}


class _Garment4dTasks:
    """Tasks by kind, for the experiment with these files."""

    def __init__(self, files: ExperimentFiles) -> None:
        self.files, self.own = files, Garment4dFiles(files)
        self.settings, self.folder = self.own.settings, self.own.folder
        self.garments, self.seed = self.own.garments, files.model_seed
        self.variants = posed_variants(self.settings["posed"])

    def data(self) -> dict[str, Task]:
        """Clouds of all sequences, and the sequences of each type."""
        found = {"labelled": self._collect_all()}
        for garment in GARMENTS:
            for protocol in PROTOCOLS:
                found[f"{garment}/data_{protocol}"] = self._collect(garment, protocol)
        return found

    def _collect_all(self) -> Task:
        files, own = self.files, self.own
        clouds = own.clouds(self.settings["protocol"])
        return Task(
            f"{_SOURCES}:collect_all",
            {
                "samples": files.per_shard(files.samples, files.moving),
                "clouds": files.per_shard(clouds, files.moving),
                "skinned": [
                    own.skinned.format(group=group, shard=shard)
                    for group, shard in own.skinned_shards
                ],
                **files.bodies,
            },
            {},
            seconds=60 * files.moving_size,
            megabytes=400 + 20 * files.moving_size,
        )

    def _collect(self, garment: str, protocol: str) -> Task:
        files, own = self.files, self.own
        wearers = own.wearers[garment]
        # Clouds of outfits at rest follow the config's protocol.
        skinned = own.skinned_wearers[garment] if protocol == self.settings["protocol"] else []
        return Task(
            f"{_SOURCES}:collect",
            {
                "samples": files.shards_of(files.samples, wearers),
                "clouds": files.shards_of(own.clouds(protocol), wearers),
                "skinned": [
                    own.skinned.format(group=group, shard=shard) for group, shard in skinned
                ],
                "outfits": [
                    files.outfits.format(group=group, shard=shard) for group, shard in skinned
                ],
                **files.bodies,
                "template": own.template(garment),
                "fits": own.learnt_fits(garment),
            },
            {"garment": garment, "components": self.settings["components"]},
            seconds=40 * files.moving_size,
            megabytes=400 + 20 * files.moving_size,
        )

    def trainings(self) -> dict[str, Task]:
        """Of our model, and of the paper's stages, their baselines and variants, for each type."""
        found = {"labels": self._train_labels()}
        for garment in self.garments:
            for name in ("canonical", "pointnet"):
                told = {
                    "pointnet": name == "pointnet",
                    "settings": self._stage_settings("canonical"),
                }
                found[f"{garment}/{name}"] = self._train("canonical", garment, "canonical", told)
            canonical = f"{self.folder}/{garment}/canonical"
            for stage, variants in (("posed", self.variants), ("mgn", MGN_VARIANTS)):
                for name, changes in variants.items():
                    settings = override_settings(self._stage_settings(stage), changes)
                    told = {"settings": settings, "mgn": stage == "mgn"}
                    found[f"{garment}/{name}"] = self._train(
                        "posed", garment, stage, told, canonical=canonical
                    )
        # Ours learns types that nothing is compared on when somebody asks for them.
        return found | {f"{garment}/ours": self._fit_ours(garment) for garment in GARMENTS}

    def _train_labels(self) -> Task:
        training = self.settings["labels"]["training"]
        # Both with the body and with one that is off.
        seconds, megabytes = self._cost("canonical", training, 2 * training["epochs"])
        return Task(
            f"{_HERE}.ours.train:train_labels",
            {**self.files.bodies, "data": self.own.labelled},
            {
                "settings": self._stage_settings("labels"),
                "trainer": self.settings["trainer"],
                "start": start_of(self.files, "labels"),
            },
            seconds=seconds,
            megabytes=megabytes,
            checks=[
                partial(self._require_sequences, garment, "labels") for garment in self.garments
            ],
            parallel=True,
            gpus=self.files.gpus("garment4d"),
        )

    def _fit_ours(self, garment: str) -> Task:
        size = self.files.moving_size
        return Task(
            f"{_HERE}.ours.train:train_ours",
            {
                **self.files.bodies,
                "data": self.own.sequences(garment),
                "clouds": self.own.labelled,
                "labels": f"{self.folder}/labels",
            },
            {
                "body_points": self.settings["body_points"],
                **{key: self.settings[key] for key in ("skinning", "refine", "proposals")},
                "accelerator": self.settings["trainer"]["accelerator"],
            },
            seconds=300 + 100 * size,
            megabytes=2000 + 20 * size,
            checks=[partial(self._require_sequences, garment, "labels")],
            modules=[OUR_SOLVER],
            gpus=min(self.files.gpus("garment4d"), 1),
        )

    def _cost(self, place: str, training: Mapping[str, Any], epochs: float) -> tuple[float, float]:
        """Seconds and megabytes of a training."""
        points = self.settings["clouds"]["points"] / 1024
        rate_s = {"canonical": 0.0046, "posed": 0.033}[place]
        frames = training["frames"] / training["stride"]
        # Linear as far as it was measured; what is larger belongs on a GPU.
        megabytes = 400 + 160 * training["batch"] * training["frames"] * points
        seconds = rate_s * epochs * self.files.moving_frames * frames * points
        return seconds, min(megabytes, 40_000)

    def _train(
        self, kind: str, garment: str, stage: str, told: Mapping[str, Any], **given: str
    ) -> Task:
        place = "canonical" if stage == "canonical" else "posed"
        training = self.settings[place]["training"]
        seconds, megabytes = self._cost(place, training, training["epochs"])
        return Task(
            f"{_HERE}.train:train_{kind}",
            {**self.files.bodies, "data": self.own.sequences(garment), **given},
            {
                **told,
                "body_points": self.settings["body_points"],
                "trainer": self.settings["trainer"],
            },
            seconds=seconds,
            megabytes=megabytes,
            checks=[partial(self._require_sequences, garment, stage)],
            parallel=True,
            gpus=self.files.gpus("garment4d"),
        )

    def _require_sequences(self, garment: str, stage: str) -> None:
        """Check that the plan has enough sequences for a stage."""
        skinned, training = self.settings["skinned"], self.settings[stage]["training"]
        planned = planned_sequences(
            garment,
            self.files.moving_plans.values(),
            [
                plan
                for group, shard in self.own.skinned_shards
                for plan in self.files.groups[group].shards[shard]
            ],
            frames=skinned["frames"],
            step=skinned["step"],
        )
        require_sequences(
            garment, planned, stage=stage, sources=training["sources"], window=training["frames"]
        )

    def _stage_settings(self, stage: str) -> dict[str, Any]:
        """Settings of a network, by group."""
        own, posed = self.settings[stage], self.settings["posed"]
        settings = {
            "network": own["network"],
            "loss": own.get("loss", posed["loss"]),
            "training": {**own["training"], "seed": self.seed},
        }
        if stage == "posed":
            settings["skinning"] = self.settings["skinning"]
        if stage in ("canonical", "labels"):
            points = self.settings["clouds"]["points"]
            settings["network"] = {**own["network"], "points": points}
        return settings

    def evaluations(self) -> dict[str, EvaluationTask]:
        """Of each type's networks, with and without variants, and the comparisons."""
        found: dict[str, tuple[Task, Sequence[str]]] = {}
        for garment in self.garments:
            # Figures 8 to 10 and other worse inputs are part of the ablations alone.
            few: dict[str, Any] = {
                key: []
                for key in (
                    *("neighbours", "missing", "accuracy"),
                    *("body_noise_rad", "point_noise_m", "views", "frame_rates"),
                )
            }
            found[garment] = (self._evaluate(garment, ["posed"], few), ("metrics", PACKAGED))
            released = {"vertex_sampled": f"{self.folder}/{garment}/data_vertices"}
            found[f"{garment}_ablations"] = (
                self._evaluate(garment, [*self.variants, _PULLED_MGN], {}, **released),
                (_ABLATIONS,),
            )
        found["floor"] = (self._floor(), (_ABLATIONS,))
        found["representations"] = (self._compare(), (REPRESENTATIONS, SYSTEMS))
        if self.files.scanned:
            found |= {
                evaluation: (self._fit_scans(kind), (table,))
                for evaluation, (kind, table) in SCAN_EVALUATIONS.items()
            }
            found["moved"] = (self._move(), (SYSTEMS,))
        return {f"evaluated/{name}": EvaluationTask(*one) for name, one in found.items()}

    def _evaluate(
        self, garment: str, variants: list[str], changed: Mapping[str, Any], **given: str
    ) -> Task:
        # Those moved by skinning are not measured, so the plan must have others.
        wearers = [self.files.moving_plans[sample] for sample in self.own.wearers[garment]]
        folder, size = f"{self.folder}/{garment}", self.files.moving_size
        return Task(
            f"{_HERE}.evaluate:evaluate_garment",
            {
                **self.files.bodies,
                "data": self.own.sequences(garment),
                **given,
                **{name: f"{folder}/{name}" for name in ("canonical", "pointnet", "mgn", "ours")},
                "posed": [f"{folder}/{variant}" for variant in variants],
            },
            {
                "posed": variants,
                "splits": EVALUATED_SPLITS,
                "settings": {**self.settings["evaluation"], "seed": self.seed, **changed},
                "accelerator": self.settings["trainer"]["accelerator"],
                "refine": self.settings["refine"],
                "body_points": self.settings["body_points"],
            },
            seconds=400 * size,
            megabytes=1200 + 20 * size,
            checks=[partial(require_simulated, garment, wearers, EVALUATED_SPLITS)],
            modules=[OUR_SOLVER],
            parallel=True,
            gpus=min(self.files.gpus("garment4d"), 1),
        )

    def _floor(self) -> Task:
        """The true garments simulated again."""
        files, own = self.files, self.own
        worn = {sample for garment in self.garments for sample in own.wearers[garment]}
        samples = files.first_of_split(
            _AGAIN, EVALUATED_SPLITS[0], lambda plan: plan.sample in worn
        )
        return Task(
            f"{_HERE}.floor:evaluate_floor",
            {
                **files.bodies,
                **self._every_sequence,
                **{
                    f"fits_{garment}": files.shards_of(
                        own.fits(garment), [one for one in own.wearers[garment] if one in samples]
                    )
                    for garment in self.garments
                },
                "samples": files.shards_of(files.samples, samples),
                "outfits": files.shards_of(files.outfits, samples),
                "motions": files.shards_of(files.moving_bodies, samples),
            },
            {
                "solver": OUR_SOLVER,
                "garments": self.garments,
                "samples": samples,
                "split": EVALUATED_SPLITS[0],
                "seed": self.seed,
            },
            seconds=20 * len(samples),
            megabytes=1500,
            modules=[OUR_SOLVER],
        )

    def _compare(self) -> Task:
        files = self.files
        return Task(
            f"{_HERE}.representation:compare_templates",
            {
                **self._every_sequence,
                **{
                    f"fits_{garment}": files.per_shard(self.own.fits(garment), files.resting)
                    for garment in self.garments
                },
                "data": files.static,
                "outfits": files.outfits_at_rest,
            },
            self.files.compared,
            seconds=1200,
            megabytes=2500,
            checks=[files.resting_in(*EVALUATED_SPLITS)],
            environment="geometry",
        )

    def _fit_scans(self, kind: str) -> Task:
        return Task(
            f"{_HERE}.scans:fit_to_scans",
            {
                **self.files.bodies,
                **self.files.known_scans(kind),
                "ours": [f"{self.folder}/{garment}/ours" for garment in self.garments],
                "networks": [f"{self.folder}/{garment}/posed" for garment in self.garments],
            },
            {"kind": kind, **self.files.compared},
            seconds=4800,
            megabytes=2500,
            modules=[OUR_SOLVER],
        )

    def _move(self) -> Task:
        return Task(
            f"{_HERE}.scans:move_garments_at_rest",
            {**self.files.bodies, **self.files.known_scans(CLEAN)},
            {
                # As printed, since true garments have short edges.
                "skinning": {**self.settings["skinning"], "passes": _PRINTED_PASSES},
                "body_points": self.settings["body_points"],
                **self.files.compared,
            },
            seconds=600,
            megabytes=1500,
        )

    def packages(self) -> dict[str, Package]:
        """Our model of each type, and labels of points."""
        ours = {
            f"garment4d/{garment}": Package(
                f"{self.folder}/{garment}/ours",
                "Garments in motion from point clouds of a dressed person",
                "moving = model.reconstruct(points, poses, shape)",
                ("garment4d",),
                ("ours", "posed", "lbs", "still"),
                (
                    *("canonical_error_mm", "vertex_error_mm", "predicted_to_true_mm"),
                    *("true_to_predicted_mm", "velocity_error_m_s", "inside_depth_mm"),
                ),
                (garment,),
            )
            for garment in self.garments
        }
        labels = Package(
            f"{self.folder}/labels",
            "What the points of a dressed person are: skin, or cloth of one of the garment types",
            "labels = model.label(points, poses, shape)",
            ("garment4d",),
            ("ours", "label_by_vertex", "one_label"),
            ("segmentation_accuracy",),
            tuple(name for name in GARMENTS if self._is_learned(name)),
        )
        return {**ours, "labels": labels}

    def _is_learned(self, garment: str) -> bool:
        """Whether anybody in the training split wears it."""
        moving = [self.files.moving_plans[sample] for sample in self.own.wearers[garment]]
        return garment in self.files.types_at_rest("train") or any(
            plan.split == "train" for plan in moving
        )

    def figures(self) -> dict[str, Figure]:
        """Tables 2 to 4 of the paper, and its figures."""
        rays = {"rays": self.files.config["renders"]["rays"]}
        reconstructions = {
            "evaluated": [f"{self.folder}/evaluated/{garment}" for garment in self.garments]
        }
        steps = partial(_shown, "garment4d_steps")
        spaces = partial(_shown, "garment4d_spaces")
        return {
            "tabulate_garment4d": self._tables("metrics", "garment4d_metrics"),
            "tabulate_garment4d_ablations": self._tables(
                _ABLATIONS, "garment4d_ablations", default=False
            ),
            "plot_garment4d_steps": figure(
                f"{_PAGES}.figures:plot_reconstructions",
                reconstructions,
                rays,
                environment="report",
                steps=steps("steps.png", "figure 4: from points to the garment"),
                results=steps("results.png", "figure 5: reconstructions"),
            ),
            "animate_garment4d": figure(
                f"{_PAGES}.figures:animate_reconstruction",
                reconstructions,
                rays,
                environment="report",
                picture=steps("moving.png", "a reconstruction in motion"),
            ),
            "plot_garment_spaces": figure(
                f"{_PAGES}.figures:plot_spaces",
                self._every_sequence,
                rays,
                environment="report",
                explained=spaces("explained.svg", "variance of the principal components"),
                modes=spaces("modes.png", "the first principal components"),
            ),
            "plot_skinning": figure(
                f"{_HERE}.figures:plot_skinning",
                {**self.files.bodies, "data": self.own.sequences(self._shown_garment())},
                {"skinning": self.settings["skinning"], **rays},
                picture=_shown(
                    "garment4d_skinning",
                    "skinning.png",
                    "figure 7: K = 1 against interpolated skinning",
                ),
            ),
            "plot_garment4d_curves": page(
                f"{_PAGES}.figures:plot_curves",
                {"metrics": self.files.metrics(_ABLATIONS)},
                {"garment": self._shown_garment()},
                default=False,
            )._replace(
                output={
                    name: _shown("garment4d_curves", f"{name}.svg", title)
                    for name, title in _CURVES.items()
                }
            ),
        }

    @property
    def _every_sequence(self) -> dict[str, str]:
        """Sequences of the types that models are compared on."""
        return {garment: self.own.sequences(garment) for garment in self.garments}

    def _shown_garment(self) -> str:
        """In figures of a single type; skirts move most."""
        return "Skirt" if "Skirt" in self.garments else self.garments[0]

    def _tables(self, table: str, name: str, *, default: bool = True) -> Figure:
        return page(
            f"{_PAGES}.tables:tabulate",
            {
                "metrics": self.files.metrics(table),
                "fits": [fits for one in self.garments for fits in self.own.learnt_fits(one)],
            },
            {"departures": self._departures()},
            default=default,
            page=ReportFile(f"{name}.html", f"tables 2 to 4 ({table})", "garment4d_tables"),
            table=f"{name}_beside_paper.tsv",
        )

    def _departures(self) -> list[str]:
        """Settings by which the experiment's models depart from the paper's."""
        canonical, posed = self.settings["canonical"], self.settings["posed"]
        settings = {
            "frames": canonical["training"]["frames"] != PAPER_FRAMES,
            "width": canonical["network"]["width"] != 1,
            "balance": canonical["loss"]["balance"],
            "interpenetration": posed["loss"]["interpenetration"] != RELEASED_INTERPENETRATION,
            "pull_neighbours": posed["network"]["pull_neighbours"],
            "smooth_passes": posed["network"]["smooth_passes"],
        }
        return [name for name, value in settings.items() if value]

    def targets(self) -> dict[str, list[str]]:
        """Figures 6 and 8 to 10."""
        report = f"{self.files.results}/report/garment4d"
        return {
            "garment4d_ablations": [
                self.files.metrics(_ABLATIONS),
                *(
                    f"{report}_{name}"
                    for name in ("ablations.html", *(f"{c}.svg" for c in _CURVES))
                ),
            ]
        }


_CURVES = {
    "ablation": "figure 6: without single parts",
    "neighbours": "figure 8: neighbours K",
    "missing": "figure 9: missing points",
    "accuracy": "figure 10: segmentation errors",
    "body_noise": "inexact bodies",
    "point_noise": "noisy points",
    "views": "few cameras",
    "frame_rate": "fewer frames",
}


def _shown(caption: str, name: str, title: str) -> ReportFile:
    return ReportFile(f"garment4d_{name}", title, caption)


def _plan(files: ExperimentFiles) -> ModelPlan:
    tasks = _Garment4dTasks(files)
    return ModelPlan(
        data=tasks.data(),
        trainings=tasks.trainings(),
        evaluations=tasks.evaluations(),
        figures=tasks.figures(),
        targets=tasks.targets(),
        packages=tasks.packages(),
        priority=1,  # the longest chain after samples, and what compares it with others
    )


MODEL = Model(
    "garment4d",
    "Garment4D",
    Garment4dSettings,
    _plan,
    loaders={
        "garment4d_ours": f"{_HERE}.ours.model:OurModel",
        "garment4d_labels": f"{_HERE}.ours.labels:LabelModel",
        "garment4d_posed": f"{_HERE}.reconstruct:NetworksModel",
    },
)
