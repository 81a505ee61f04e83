"""Rule `plot_garment4d_steps`: figures 4 and 5, and a reconstruction in motion."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from drapeline.metrics.garment4d import load_reconstruction
from drapeline.report.garment4d_figures import animate_steps, plot_results, plot_steps
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

_STEPS, _RESULTS, _MOVING = 2, 5, 24


def spread(count: int, shown: int) -> list[int]:
    """At most `shown` of `count` frames, evenly spread."""
    shown = min(shown, count)
    return [round((k + 0.5) * count / shown - 0.5) for k in range(shown)]


with rule_log(snakemake.log[0]):
    cases = [
        load_reconstruction(next(iter(sorted(Path(folder).glob("*.npz")))))
        for folder in snakemake.input.reconstructions
    ]
    plot_steps(snakemake.output.steps, [(c, spread(len(c.final), _STEPS)) for c in cases])
    plot_results(snakemake.output.results, [(c, spread(len(c.final), _RESULTS)) for c in cases])
    first = cases[0]
    shown = slice(0, _MOVING)
    animate_steps(
        snakemake.output.moving,
        replace(
            first,
            **{
                name: getattr(first, name)[shown]
                for name in ("proposal", "final", "true", "points", "labels", "body")
            },
            root_rotation=first.root_rotation[shown],
            root_height=first.root_height[shown],
            number=first.number[shown],
        ),
    )
