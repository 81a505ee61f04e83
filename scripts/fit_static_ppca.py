"""Rule `fit_static_ppca`: masked probabilistic PCA of garments in rest pose."""

from typing import TYPE_CHECKING

import torch

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.data import static_body_template
from drapeline.models.gcvae.load import save_static_files
from drapeline.models.gcvae.ppca import StaticPpca, save_fit
from drapeline.models.gcvae.settings import PpcaSettings
from drapeline.registration.to_body.hierarchy import load_hierarchy
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]):
    given = snakemake.input
    torch.set_num_threads(snakemake.threads)
    garments, topology = StaticData(given.data), load_topology(given.topology)
    template = static_body_template(
        garments,
        topology,
        load_hierarchy(given.hierarchy),
        {gender: load_body(given[gender]) for gender in GENDERS},
    )
    model = StaticPpca(PpcaSettings(**snakemake.params.settings), template)
    model.fit(garments)
    save_fit(
        snakemake.output[0],
        model,
        lambda folder: save_static_files(folder, model, garments, topology),
    )
