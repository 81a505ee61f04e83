"""Rule `copy_body`: the free bodies that come with drapeline, one file per gender."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import free_body
from drapeline.frames import GENDERS
from drapeline.rule_log import rule_log
from drapeline.storage import copy_file

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    for gender in GENDERS:
        copy_file(free_body(gender), snakemake.output[gender])
