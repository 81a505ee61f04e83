"""Trained models as a package brings them: small, described, and loaded by name.

    drapeline.load("garment4d/Skirt")

Numbers are stored in half precision, and free bodies by their version.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drapeline import __version__
from drapeline.dataset.card import markdown_table
from drapeline.dataset.record import SPLITS
from drapeline.errors import InputError
from drapeline.job import Job
from drapeline.metrics.table import ALL
from drapeline.models.registry import Package
from drapeline.models.start import ABOUT
from drapeline.models.training.checkpoints import SMALL, halve, read_checkpoint, write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.report.tables import MetricTable, garment_title, read_test_metrics
from drapeline.schema import Table
from drapeline.storage import atomic_folder, load_npz, save_npz, write_json

CARD = "README.md"


def pack_model(folder: str | Path, output: Path) -> None:
    """Write a trained model as small as it can be used.

    Raises:
        InputError: a file is missing or damaged, or a number is too large for half precision.
    """
    folder = Path(folder)
    checkpoint = read_checkpoint(folder / BEST)
    write_checkpoint(output / BEST, halve(checkpoint.weights), halve(checkpoint.metadata))
    for path in sorted(folder.rglob("*.npz")):
        target = output / path.relative_to(folder)
        target.parent.mkdir(parents=True, exist_ok=True)
        arrays = load_npz(path, {"*": "any|nan ..."})
        save_npz(target, **{key: _halved(path, key, array) for key, array in arrays.items()})


def _halved(path: Path, key: str, array: np.ndarray) -> np.ndarray:
    if array.dtype.kind != "f" or array.size < SMALL:
        return array
    with np.errstate(over="ignore"):  # refused below
        half = array.astype(np.float16)
    lost = np.isinf(half) & np.isfinite(array)
    if lost.any():
        raise InputError(
            f"{path}: '{key}' is up to {np.abs(array[lost]).max():g}, expected at most"
            f" {np.finfo(np.float16).max:g} in half precision"
        )
    return half


def card(name: str, model: Package, about: Mapping[str, Any], metrics: Table) -> str:
    """What a model is, what it has learned from, how well it does, and what it cannot do.

    Args:
        about: `config`, `commit` and `seed` of the experiment, numbers of `samples` by split, in
            motion and at rest, `clips` by split, and the ids of samples that were `learned` from.
        metrics: of the test split, see `read_test_metrics`.
    """
    ours = metrics[metrics["model"].isin(model.models)]
    garments = [*model.garments, ALL] if len(model.garments) > 1 else model.garments
    table = MetricTable(model.variants, model.metrics, garments, down=("variant", "garment"))
    rows = [
        {"split": split, **about["samples"][split], "clips": ", ".join(about["clips"][split])}
        for split in SPLITS
    ]
    return f"""\
# {name}

{model.title}, by drapeline {__version__}.

```python
import drapeline

model = drapeline.load("{name}")
{model.use}
```

It knows {_listed(model.garments)}, on bodies of [Anny](https://github.com/naver/anny) in SMPL's format.

## Data

An experiment of drapeline, `{about["config"]}`, at commit {about["commit"]}, with the seed {about["seed"]}: outfits at rest, and
simulated samples in motion. It has learned from the training split, and choices were made on the
validation split; no clip and no body is in two of them.

{markdown_table(rows)}

## On the test split

Means with 95 % intervals over clips, or over outfits at rest, measured before the weights were rounded to half precision.

{markdown_table([{key: str(value) for key, value in row.items()} for row in table.rows(ours)])}

## Limits

- It knows simulated cloth of drapeline's garment types alone, on bodies without hair or shoes, in clips such as those above.
- Garments have one layer, without seams, pockets or buttons.

## Licence

Apache-2.0, as drapeline itself. Bodies derive from Anny (Apache-2.0 code, CC0 data). Clips of the CMU Graphics Lab Motion Capture
Database (mocap.cs.cmu.edu), which may be used freely, and of DeepMimic (MIT), are not contained.
"""  # noqa: E501


def _listed(names: Sequence[str]) -> str:
    plural = {"dress": "dresses", "trousers": "trousers"}
    titles = [plural.get(one, f"{one}s") for one in (garment_title(name).lower() for name in names)]
    return titles[0] if len(titles) == 1 else f"{', '.join(titles[:-1])} and {titles[-1]}"


def pack_models(job: Job) -> None:
    """Leave the folder of all models that come with drapeline, each with its card.

    Args:
        job: its input has the table of `metrics`; its params have `models`, name -> fields of a
            `Package`, and `about`, see `card`, with the `body_files` of the experiment.

    Raises:
        InputError: there are some of these, or see `pack_model`.
    """
    if own := job.params.about["body_files"]:
        raise InputError(
            f"body.files names {', '.join(own)}, whose licence need not let you pass on models of"
            " it; expected the bodies that come with drapeline"
        )
    metrics = read_test_metrics(job.input.metrics)
    with atomic_folder(job.output[0]) as scratch:
        write_json(
            scratch / ABOUT,
            {
                "seed": job.params.about["seed"],
                "clips": job.params.about["clips"]["train"],
                "samples": job.params.about["learned"],
            },
        )
        for name, fields in job.params.models.items():
            model = Package(**fields)
            pack_model(model.folder, scratch / name)
            (scratch / name / CARD).write_text(card(name, model, job.params.about, metrics))
