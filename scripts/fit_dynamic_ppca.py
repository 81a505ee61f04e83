"""Rule `fit_dynamic_ppca`: masked probabilistic PCA of garments in motion."""

from typing import TYPE_CHECKING

import torch

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.models.gcvae.data import dynamic_body_template
from drapeline.models.gcvae.load import load_dynamic_garments
from drapeline.models.gcvae.ppca import DynamicPpca, save_fit
from drapeline.models.gcvae.settings import PpcaSettings
from drapeline.registration.to_body.hierarchy import load_hierarchy
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given, params = snakemake.input, snakemake.params
    torch.set_num_threads(snakemake.threads)
    garments = load_dynamic_garments(given.data, given.static, params.frames)
    template = dynamic_body_template(
        garments,
        load_topology(given.topology),
        load_hierarchy(given.hierarchy),
        {gender: load_body(given[gender]) for gender in GENDERS},
    )
    model = DynamicPpca(PpcaSettings(**params.settings), template)
    model.fit(garments)
    save_fit(snakemake.output[0], model)
