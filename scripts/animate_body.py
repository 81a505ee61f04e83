"""Rule `animate_body`: a random body shape, moving through its clip, free of self-collisions."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.bodies.sequence import save_body_sequence
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.generation.body import animate
from drapeline.generation.settings import BodySettings
from drapeline.motions.motion import load_motion
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    given, params = snakemake.input, snakemake.params
    record = animate(
        SamplePlan(**params.plan),
        load_motion(given.motion),
        load_body(given.body),
        BodySettings(**params.settings),
        params.seed,
    )
    save_body_sequence(snakemake.output[0], record)
    log.info("%s: self-collision %s", record.labels.sequence, record.outcome)
