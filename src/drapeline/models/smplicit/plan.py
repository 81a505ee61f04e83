"""What an experiment does with SMPLicit."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

from drapeline.dataset.settings import CLEAN
from drapeline.errors import InputError
from drapeline.experiment.files import EVALUATED_SPLITS, ExperimentFiles
from drapeline.models.pictures.plan import pictured_samples
from drapeline.models.registry import (
    CODE_SIZES,
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
from drapeline.models.smplicit.garments import FIELD_MODELS, MODEL_OF_GARMENT
from drapeline.models.smplicit.settings import SmplicitSettings
from drapeline.models.start import start_of

_HERE = "drapeline.models.smplicit"
_PAGES = "drapeline.report.models.smplicit"
_SHEETS = {
    "samples": "sampled garments",
    "prototypes": "prototypes",
    "transitions": "between prototypes",
    "axes": "principal axes of the cut",
    "bodies": "one garment on five bodies",
    "edits": "single properties edited",
}


class SmplicitFiles:
    """Files that SMPLicit has of its own, and what its jobs are told alike."""

    def __init__(self, files: ExperimentFiles) -> None:
        self._files = files
        self.settings = files.config["smplicit"]
        self.folder = f"{files.results}/smplicit"
        # Names of its models, one for each region of the body.
        self.names = self.settings["models"]
        self.models = [f"{self.folder}/{name}" for name in self.names]
        self.fields = f"{self.folder}/fields/{{group}}/{{shard}}.npz"

    def draping(self, fit: str) -> dict[str, Any]:
        """What "fit_images" or "fit_scans" is told, which lets decoded garments hang on people."""
        return {
            "fit": self.settings[fit],
            "meshing": self.settings["meshing"],
            **self._files.hanging,
            "seed": self._files.model_seed,
        }


class _SmplicitTasks:
    """Tasks by kind, for the experiment with these files."""

    def __init__(self, files: ExperimentFiles) -> None:
        self.files, self.own = files, SmplicitFiles(files)
        self.settings, self.folder = self.own.settings, self.own.folder
        self.seed, self.gallery = files.model_seed, self.settings["gallery"]
        self.rays = {"rays": files.config["renders"]["rays"]}

    def data(self) -> dict[str, Task]:
        """Distance fields of the garments of each model."""
        size = self.files.static_size
        return {
            f"data/{name}": Task(
                "drapeline.learning_data.garment_fields:collect",
                {
                    **self.files.bodies,
                    "shards": self.files.per_shard(self.own.fields, self.files.resting),
                },
                {
                    "garments": model.garments,
                    "resolution": self.settings["data"]["resolution"],
                    "clusters": self.settings["data"]["clusters"],
                },
                seconds=2 * size,
                megabytes=200 * size,
                checks=[self.files.resting_in("train", "val")],
                environment="geometry",
            )
            for name, model in FIELD_MODELS.items()
        }

    @property
    def _code_folders(self) -> dict[tuple[str, int | None], str]:
        """Model, and the size of its codes if that is not the config's -> folder.

        Other sizes are for comparisons with other models' codes, of types that all of them know.
        """
        own = sum(self.settings["network"][part] for part in ("cut", "style"))
        others = [size for size in CODE_SIZES if size != own]
        compared = {MODEL_OF_GARMENT[garment] for garment in self._compared}
        return {
            **{(name, None): name for name in FIELD_MODELS},
            **{
                (name, size): f"{name}_{size}"
                for name in FIELD_MODELS
                for size in others
                if name in compared
            },
        }

    @property
    def _compared(self) -> list[str]:
        """Types on which all models are compared, as far as a model here has learned them."""
        compared = self.files.compared_garments
        return [name for name in compared if MODEL_OF_GARMENT[name] in self.own.names]

    def trainings(self) -> dict[str, Task]:
        """Of each model."""
        settings, outfits = self.settings, len(self.files.resting_plans)
        found = {}
        for (name, size), folder in self._code_folders.items():
            model, network = FIELD_MODELS[name], settings["network"]
            if size is not None:
                network = {**network, "cut": size // 3, "style": size - size // 3}
            training = {**settings["training"], "seed": self.seed}
            training["space"] *= model.space_share
            found[folder] = Task(
                f"{_HERE}.train:train",
                {
                    **self.files.bodies,
                    "data": f"{self.folder}/data/{name}",
                    # The file that the image encoder starts from, if there is one.
                    "weights": network["encoder_weights"] or [],
                },
                {
                    "name": name,
                    "settings": {
                        "network": network,
                        "loss": settings["loss"],
                        "training": training,
                    },
                    "trainer": settings["trainer"],
                    "start": start_of(self.files, f"smplicit/{folder}"),
                },
                seconds=0.004 * training["epochs"] * training["visits"] * outfits,
                megabytes=700 + 20 * self.files.static_size,
                parallel=True,
                gpus=self.files.gpus("smplicit"),
            )
        return found

    def evaluations(self) -> dict[str, EvaluationTask]:
        """Of each model, in pictures of people, and the comparisons with other models."""
        found: dict[str, tuple[Task, Sequence[str]]] = {
            folder: (
                self._evaluate(name, folder),
                ("metrics", PACKAGED) if size is None and name in self.own.names else (),
            )
            for (name, size), folder in self._code_folders.items()
        }
        if self._samples:
            found["images"] = (self._find_in_pictures(), ("metrics", SYSTEMS))
        if self._compared:
            sizes = sorted({size for _, size in self._code_folders if size is not None})
            found["representations"] = (self._compare([None]), (REPRESENTATIONS, SYSTEMS))
            found["other_codes"] = (self._compare(sizes), (SYSTEMS,))
        if self.files.scanned:
            found |= {
                evaluation: (self._fit_scans(kind), (table,))
                for evaluation, (kind, table) in SCAN_EVALUATIONS.items()
            }
            found["moved"] = (self._move(), (SYSTEMS,))
        return {f"evaluated/{name}": EvaluationTask(*one) for name, one in found.items()}

    def _evaluate(self, name: str, folder: str) -> Task:
        return Task(
            f"{_HERE}.evaluate:evaluate",
            {
                "model": f"{self.folder}/{folder}",
                "data": f"{self.folder}/data/{name}",
                "outfits": self.files.outfits_at_rest,
            },
            {
                "split": EVALUATED_SPLITS[0],
                "meshing": self.settings["meshing"],
                "fit": self.settings["evaluation"],
                "seed": self.seed,
            },
            seconds=120 * self.files.static_size,
            megabytes=2500,
            parallel=True,
        )

    @cached_property
    def _pictured(self) -> dict[str, Any]:
        """What an evaluation is told of pictures; see `pictured_samples`."""
        return pictured_samples(self.files)

    @property
    def _samples(self) -> list[str]:
        """Held-out samples whose garments are looked for in pictures of them."""
        return self._pictured["samples"] + self._pictured["others"]

    def _find_in_pictures(self) -> Task:
        told = self._pictured
        return Task(
            f"{_HERE}.pictures.evaluate:evaluate_images",
            {
                "models": self.own.models,
                "samples": self.files.shards_of(self.files.samples, self._samples),
            },
            {**self.own.draping("fit_images"), **told},
            seconds=30 * (told["pictures"] + len(told["others"])),
            megabytes=2000,
            modules=[self.files.hanging_solver],
        )

    def _compare(self, sizes: Sequence[int | None]) -> Task:
        garments = self._compared
        models = sorted({MODEL_OF_GARMENT[garment] for garment in garments})
        variants = {
            "smplicit" if size is None else f"smplicit_{size}": [
                f"{self.folder}/evaluated/{self._code_folders[name, size]}" for name in models
            ]
            for size in sizes
        }
        return Task(
            f"{_HERE}.representation:compare_codes",
            {
                **variants,
                "data": self.files.static,
                "outfits": self.files.outfits_at_rest,
            },
            {
                "variants": [*variants],
                "garments": garments,
                "split": EVALUATED_SPLITS[0],
                "seed": self.seed,
            },
            seconds=1200,
            megabytes=1300,
            checks=[self.files.resting_in(*EVALUATED_SPLITS)],
        )

    def _fit_scans(self, kind: str) -> Task:
        return Task(
            f"{_HERE}.scans.evaluate:fit_to_scans",
            {**self.files.known_scans(kind), "models": self.own.models},
            {
                **self.own.draping("fit_scans"),
                "kind": kind,
                **self.files.compared,
                "body": self.files.config["scans"]["body"],
            },
            seconds=4800,
            megabytes=2500,
            modules=[self.files.hanging_solver],
        )

    def _move(self) -> Task:
        return Task(
            f"{_HERE}.scans.evaluate:move_garments_at_rest",
            {**self.files.bodies, **self.files.known_scans(CLEAN)},
            self.files.compared,
            seconds=600,
            megabytes=1500,
        )

    def packages(self) -> dict[str, Package]:
        """The model of each part of the body."""
        return {
            f"smplicit/{name}": Package(
                f"{self.folder}/{name}",
                "Garments at rest as codes of a distance field, to be decoded and fitted",
                'garment = model.decode(model.mean_code, gender="female", shape=[0.0] * 10)',
                ("smplicit",),
                tuple(f"smplicit_{name}_{way}" for way in ("fitted", "nearest_cut", "mean_code")),
                ("surface_to_true_mm", "true_to_surface_mm", "openings_right"),
                FIELD_MODELS[name].garments,
            )
            for name in self.own.names
        }

    def samples(self) -> dict[str, Task]:
        """Garments sampled, interpolated and edited."""
        return {
            f"gallery/{name}": Task(
                f"{_HERE}.gallery.files:make_gallery",
                {"model": f"{self.folder}/{name}", "outfits": self.files.outfits_at_rest},
                {
                    "samples": self.gallery["count"],
                    "meshing": self.settings["meshing"],
                    "seed": self.seed,
                },
                seconds=2400,
                megabytes=2500,
                parallel=True,
            )
            for name in FIELD_MODELS
        }

    def figures(self) -> dict[str, Figure]:
        """Held-out garments, those in pictures, and the gallery."""
        evaluated = f"{self.folder}/evaluated"
        found = {
            "tabulate_smplicit": page(
                f"{_PAGES}.tables:tabulate",
                {"metrics": self.files.metrics("metrics")},
                {},
                page=_shown("metrics.html", "held-out garments through their codes"),
            ),
            "plot_smplicit": figure(
                f"{_HERE}.figures:plot_held_out",
                {
                    "models": self.own.models,
                    "data": [f"{self.folder}/data/{name}" for name in self.own.names],
                    "evaluated": [f"{evaluated}/{name}" for name in self.own.names],
                    "outfits": self.files.outfits_at_rest,
                },
                {"meshing": self.settings["meshing"], **self.rays},
                picture=_shown("garments.png", "held-out garments rebuilt from their codes"),
            ),
        }
        if self._samples:
            found["plot_fit_images"] = figure(
                f"{_PAGES}.figures:plot_evaluated_pictures",
                {"evaluated": f"{evaluated}/images"},
                {"most": 8, **self.rays},
                environment="report",
                picture=_shown("images.png", "garments found in pictures of held-out samples"),
            )
        return {
            **found,
            **{f"plot_smplicit_gallery_{name}": self._sheets(name) for name in FIELD_MODELS},
            **{f"pose_smplicit_{name}": self._pose(name) for name in FIELD_MODELS},
            "tabulate_smplicit_gallery": self._codes(),
        }

    def _sheets(self, name: str) -> Figure:
        sheets = {
            sheet: _shown(f"{name}_{sheet}.png", f"{title} ({name})", sheet)
            for sheet, title in _SHEETS.items()
        }
        return figure(
            f"{_HERE}.figures:plot_sheets",
            {**self.files.bodies, "gallery": f"{self.folder}/gallery/{name}"},
            self.rays,
            seconds=1200,
            default=False,
        )._replace(output=sheets)

    def _pose(self, name: str) -> Figure:
        config, gallery = self.files.config, self.gallery
        sample = gallery["sample"] or next(iter(self.files.moving_plans), "")
        place = self.files.places.get(sample, {"group": "", "shard": ""})
        return figure(
            f"{_HERE}.figures:pose_garment",
            {
                "model": f"{self.folder}/{name}",
                "gallery": f"{self.folder}/gallery/{name}",
                "bodies": self.files.moving_bodies.format(**place),
            },
            {
                **{key: gallery[key] for key in ("frames", "skinning", "push_out", "simulate")},
                "sample": sample,
                "solver": self.files.hanging_solver,
                "edge_length_m": config["outfits"]["edge_length_m"],
                "simulation": config["simulation"]["settings"],
                "bounds": config["simulation"]["bounds"],
                "shown": 6,
                "meshing": self.settings["meshing"],
                **self.rays,
            },
            seconds=1200,
            checks=[self._require_gallery_sample],
            modules=[self.files.hanging_solver],
            default=False,
            sheet=_shown(f"{name}_posed.png", f"a garment posed ({name})", "posed"),
            moving=_shown(f"{name}_moving.png", f"a garment in motion ({name})", "posed"),
            scene=f"smplicit_{name}.glb",
        )

    def _require_gallery_sample(self) -> None:
        """Check that there is the sample whose motion garments are put on."""
        sample, known = self.gallery["sample"], self.files.moving_plans
        if sample not in known and (sample or not known):
            raise InputError(
                f"smplicit.gallery.sample: '{sample}', expected one of the samples, such as"
                f" {next(iter(known), None)}"
            )

    def _codes(self) -> Figure:
        return page(
            f"{_PAGES}.tables:tabulate_gallery",
            {"galleries": [f"{self.folder}/gallery/{name}" for name in self.gallery["models"]]},
            {"models": self.gallery["models"]},
            default=False,
            page=_shown("codes.html", "what codes say about garments"),
            table="smplicit_correlations.tsv",
        )

    def targets(self) -> dict[str, list[str]]:
        """Garments sampled, interpolated, edited and posed; and those found in pictures."""
        report = f"{self.files.results}/report/smplicit"
        names = [*(f"{sheet}.png" for sheet in _SHEETS), "posed.png", "moving.png"]
        pictures = {"evaluate_images": [f"{self.folder}/evaluated/images"]}
        return {
            **(pictures if self._samples else {}),
            "smplicit_gallery": [
                f"{report}_codes.html",
                *(f"{report}_{model}_{name}" for model in self.gallery["models"] for name in names),
            ],
        }


def _shown(name: str, title: str, caption: str | None = None) -> ReportFile:
    return ReportFile(f"smplicit_{name}", title, f"smplicit_{caption or name.partition('.')[0]}")


def _plan(files: ExperimentFiles) -> ModelPlan:
    tasks = _SmplicitTasks(files)
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
    "smplicit",
    "SMPLicit",
    SmplicitSettings,
    _plan,
    loaders={"smplicit": f"{_HERE}.model:SmplicitModel"},
)
