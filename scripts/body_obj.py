"""Rule `body_obj`: the mean body in the rest pose, to model garments on."""

from typing import TYPE_CHECKING

import numpy as np

from drapeline.bodies.model import load_body
from drapeline.bodies.rest_body import rest_body
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import save_obj
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    for gender in GENDERS:
        body = load_body(snakemake.input[gender])
        vertices = rest_body(body, np.zeros(10)).astype(np.float32)
        save_obj(snakemake.output[gender], Mesh(vertices, body.faces, body.vt, body.ft))
