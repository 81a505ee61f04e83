"""Rule `plot_garment4d_steps`: figures 4 and 5, and a reconstruction in motion."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.errors import InputError
from drapeline.metrics.garment4d import load_reconstruction
from drapeline.report.garment4d_figures import (
    animate_steps,
    plot_results,
    plot_steps,
    spread,
)
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

_STEPS, _RESULTS, _MOVING = 2, 5, 24
_PER_FRAME = (
    *("proposal", "final", "true", "points", "labels", "body"),
    *("root_rotation", "root_height", "number"),
)

with rule_log(snakemake.log[0]):
    # Of each type the first test sequence; names of simulated ones come before the others'.
    found = [sorted(Path(folder).glob("*_ours.npz"))[:1] for folder in snakemake.input]
    ours = [path for paths in found for path in paths]
    if not ours:
        raise InputError(
            f"{snakemake.input[0]}: no sequence of any type is in the test split, expected one or"
            " more; ask for more samples or for a larger share"
        )
    plain = [path.with_name(path.name.replace("_ours", "")) for path in ours]
    steps, results = ([load_reconstruction(path) for path in paths] for paths in (plain, ours))
    plot_steps(snakemake.output.steps, [(c, spread(len(c.final), _STEPS)) for c in steps])
    plot_results(snakemake.output.results, [(c, spread(len(c.final), _RESULTS)) for c in results])
    first = results[0]
    animate_steps(
        snakemake.output.moving,
        replace(first, **{name: getattr(first, name)[:_MOVING] for name in _PER_FRAME}),
    )
