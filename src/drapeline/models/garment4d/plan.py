"""What an experiment does with Garment4D."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from drapeline.experiment.checks import planned_sequences, require_sequences, require_simulated
from drapeline.experiment.cloth_solvers import OUR_SOLVER
from drapeline.experiment.files import EVALUATED_SPLITS, ExperimentFiles
from drapeline.models.garment4d.settings import Garment4dSettings, posed_variants
from drapeline.models.registry import (
    EvaluationTask,
    Figure,
    Model,
    ModelPlan,
    ReportFile,
    Task,
    figure,
    page,
)
from drapeline.models.training.settings import override_settings

_HERE = "drapeline.models.garment4d"
_PAGES = "drapeline.report.models.garment4d"
_ABLATIONS = "metrics_garment4d_ablations"
PROTOCOLS = ("surface", "vertices")


class Garment4dFiles:
    """Files that Garment4D has of its own, by what they hold.

    Patterns have `{group}` and `{shard}`.
    """

    def __init__(self, files: ExperimentFiles) -> None:
        self._files = files
        self.settings = files.config["garment4d"]
        self.folder = f"{files.results}/garment4d"
        # Garment types that the networks learn, one network of each stage for each type.
        self.garments = self.settings["garments"]
        self.templates = {name: f"{self.folder}/{name}/template.npz" for name in self.garments}
        self.fits = f"{self.folder}/fits/{{group}}/{{shard}}"
        self.skinned = f"{self.folder}/skinned/{{group}}/{{shard}}"
        # Shards of outfits at rest that the networks learn from besides simulated samples.
        shards = [(group.name, shard) for group in files.resting for shard in group.shards]
        self.skinned_shards = shards[: self.settings["skinned"]["shards"]]
        # Samples that wear one of the types.
        self.wearers = [
            sample
            for sample, planned in files.moving_plans.items()
            if set(planned.outfit_type.split("+")) & set(self.garments)
        ]
        # Sequences of each type, sampled as the config says.
        self.sequences = {
            name: f"{self.folder}/{name}/data_{self.settings['protocol']}" for name in self.garments
        }

    def clouds(self, protocol: str) -> str:
        """Pattern of point clouds of samples."""
        return f"{self.folder}/clouds_{protocol}/{{group}}/{{shard}}"

    @property
    def learnt_fits(self) -> list[str]:
        """Templates fitted to all garments that the networks learn from or are tested on."""
        skinned = [
            self.fits.format(group=group, shard=shard) for group, shard in self.skinned_shards
        ]
        return [*skinned, *self._files.shards_of(self.fits, self.wearers)]


class _Garment4dTasks:
    """Tasks by kind, for the experiment with these files."""

    def __init__(self, files: ExperimentFiles) -> None:
        self.files, self.own = files, Garment4dFiles(files)
        self.settings, self.folder = self.own.settings, self.own.folder
        self.garments, self.seed = self.own.garments, files.config["seed"]
        # Whether networks ask where on the known body points are.
        self.body_relative_points = self.settings["canonical"]["network"]["body_relative_points"]
        self.variants = posed_variants(self.settings["posed"])

    def data(self) -> dict[str, Task]:
        """Sequences of each type."""
        return {
            f"{garment}/data_{protocol}": self._collect(garment, protocol)
            for garment in self.garments
            for protocol in PROTOCOLS
        }

    def _collect(self, garment: str, protocol: str) -> Task:
        files, own = self.files, self.own
        # Clouds of outfits at rest follow the config's protocol.
        skinned = own.skinned_shards if protocol == self.settings["protocol"] else []
        return Task(
            "drapeline.learning_data.sequence_sources:collect",
            {
                "samples": files.shards_of(files.samples, own.wearers),
                "clouds": files.shards_of(own.clouds(protocol), own.wearers),
                "skinned": [
                    own.skinned.format(group=group, shard=shard) for group, shard in skinned
                ],
                "outfits": [
                    files.outfits.format(group=group, shard=shard) for group, shard in skinned
                ],
                **(files.bodies if self.body_relative_points else {}),
                "template": own.templates[garment],
                "fits": own.learnt_fits,
            },
            {
                "garment": garment,
                "components": self.settings["components"],
                "body_relative_points": self.body_relative_points,
            },
            seconds=25 * files.moving_size,
            megabytes=400 + 20 * files.moving_size,
        )

    def trainings(self) -> dict[str, Task]:
        """Of both stages, their baselines and their variants, for each type."""
        found = {}
        for garment in self.garments:
            for name in ("canonical", "pointnet"):
                told = {
                    "pointnet": name == "pointnet",
                    "settings": self._stage_settings("canonical"),
                }
                found[f"{garment}/{name}"] = self._train("canonical", garment, "canonical", told)
            canonical = f"{self.folder}/{garment}/canonical"
            for name in (*self.variants, "mgn"):
                stage = "mgn" if name == "mgn" else "posed"
                changed = override_settings(
                    self._stage_settings(stage), self.variants.get(name, {})
                )
                kind, told = "compared", {"settings": changed, "mgn": name == "mgn"}
                if name == "posed":  # the one to be used
                    own = {key: self.settings[key] for key in ("refine", "proposals")}
                    kind, told = "posed", {"settings": changed, **own}
                found[f"{garment}/{name}"] = self._train(
                    kind, garment, stage, told, canonical=canonical
                )
        return found

    def _train(
        self, kind: str, garment: str, stage: str, told: Mapping[str, Any], **given: str
    ) -> Task:
        place = "canonical" if stage == "canonical" else "posed"
        own, points = self.settings[place], self.settings["clouds"]["points"] / 1024
        training = own["training"]
        rate_s = {"canonical": 0.0046, "posed": 0.033}[place]
        frames = training["frames"] / training["stride"]
        # Linear as far as it was measured; what is larger belongs on a GPU.
        batch_mb = 400 + 160 * training["batch"] * training["frames"] * points
        return Task(
            f"{_HERE}.train:train_{kind}",
            {**self.files.bodies, "data": self.own.sequences[garment], **given},
            {
                **told,
                "body_points": self.settings["body_points"],
                "trainer": self.settings["trainer"],
            },
            seconds=rate_s * training["epochs"] * self.files.moving_frames * frames * points,
            megabytes=min(batch_mb, 40_000),
            checks=[partial(self._require_sequences, garment, stage)],
            modules=[OUR_SOLVER] if kind == "posed" else [],
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
        if stage == "canonical":
            points = self.settings["clouds"]["points"]
            settings["network"] = {**own["network"], "points": points}
        return settings

    def evaluations(self) -> dict[str, EvaluationTask]:
        """Of each type's networks, with and without variants, and the comparisons."""
        found: dict[str, tuple[Task, Sequence[str]]] = {}
        for garment in self.garments:
            # Figures 8 to 10 and noisy bodies are part of the ablations alone.
            few: dict[str, Any] = {key: [] for key in ("neighbours", "missing", "accuracy")}
            few |= {"noise_pose_rad": 0.0, "noise_shape": 0.0}
            found[garment] = (self._evaluate(garment, ["posed"], few), ("metrics",))
            released = {"vertex_sampled": f"{self.folder}/{garment}/data_vertices"}
            found[f"{garment}_ablations"] = (
                self._evaluate(garment, list(self.variants), {}, **released),
                (_ABLATIONS,),
            )
        found["representations"] = (self._compare(), ("representations",))
        if self.files.scanned:
            found["scans"] = (self._fit_scans(), ("scans",))
        return {f"evaluated/{name}": EvaluationTask(*one) for name, one in found.items()}

    def _evaluate(
        self, garment: str, variants: list[str], changed: Mapping[str, Any], **given: str
    ) -> Task:
        # Those moved by skinning are not measured, so the plan must have others.
        wearers = [
            plan
            for plan in self.files.moving_plans.values()
            if garment in plan.outfit_type.split("+")
        ]
        folder, size = f"{self.folder}/{garment}", self.files.moving_size
        return Task(
            f"{_HERE}.evaluate:evaluate_garment",
            {
                **self.files.bodies,
                "data": self.own.sequences[garment],
                **given,
                **{name: f"{folder}/{name}" for name in ("canonical", "pointnet", "mgn")},
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

    def _compare(self) -> Task:
        files = self.files
        return Task(
            f"{_HERE}.representation:compare_templates",
            {
                **self.own.sequences,
                "fits": files.per_shard(self.own.fits, files.resting),
                "data": files.static,
                "outfits": files.outfits_at_rest,
            },
            {"garments": files.compared_garments, "split": EVALUATED_SPLITS[0], "seed": self.seed},
            seconds=1200,
            megabytes=2500,
            checks=[files.resting_in(*EVALUATED_SPLITS)],
            environment="geometry",
        )

    def _fit_scans(self) -> Task:
        return Task(
            f"{_HERE}.scans:fit_to_scans",
            {
                **self.files.bodies,
                **self.files.known_scans,
                "models": [f"{self.folder}/{garment}/posed" for garment in self.garments],
            },
            {"split": EVALUATED_SPLITS[0], "seed": self.seed},
            seconds=4800,
            megabytes=2500,
            modules=[OUR_SOLVER],
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
                self.own.sequences,
                rays,
                environment="report",
                explained=spaces("explained.svg", "variance of the principal components"),
                modes=spaces("modes.png", "the first principal components"),
            ),
            "plot_skinning": figure(
                f"{_HERE}.figures:plot_skinning",
                {**self.files.bodies, "data": self.own.sequences[self._shown_garment()]},
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

    def _shown_garment(self) -> str:
        """In figures of a single type; skirts move most."""
        return "Skirt" if "Skirt" in self.garments else self.garments[0]

    def _tables(self, table: str, name: str, *, default: bool = True) -> Figure:
        return page(
            f"{_PAGES}.tables:tabulate",
            {"metrics": self.files.metrics(table), "fits": self.own.learnt_fits},
            {"departures": self._departures()},
            default=default,
            page=ReportFile(f"{name}.html", f"tables 2 to 4 ({table})", "garment4d_tables"),
            table=f"{name}_beside_paper.tsv",
        )

    def _departures(self) -> list[str]:
        """Settings by which the experiment's models depart from the paper's."""
        canonical, posed = self.settings["canonical"], self.settings["posed"]
        settings = {
            "body_relative_points": canonical["network"]["body_relative_points"],
            "balance": canonical["loss"]["balance"],
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
        priority=1,  # the longest chain after samples, and what compares it with others
    )


MODEL = Model(
    "garment4d",
    "Garment4D",
    Garment4dSettings,
    _plan,
    loaders={"garment4d_posed": f"{_HERE}.reconstruct:ReconstructionModel"},
)
