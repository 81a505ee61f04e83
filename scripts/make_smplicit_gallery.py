"""Rule `make_smplicit_gallery`: garments of a model's codes, with what the codes say about them."""

from typing import TYPE_CHECKING

from drapeline.models.smplicit.gallery.files import save_gallery
from drapeline.models.smplicit.gallery.plan import code_space, plan_gallery, training_measures
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.settings import Meshing
from drapeline.outfits.static import load_static
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    wanted = snakemake.params
    model = SmplicitModel(snakemake.input.model)
    outfits = [outfit for path in snakemake.input.outfits for outfit in load_static(path)]
    measures = training_measures(model, outfits)
    cut = model.network.settings.network.cut
    space = code_space(model.name, model.codes, measures, cut)
    shown = plan_gallery(model.codes, space, model.bodies, seed=wanted.seed, count=wanted.samples)
    rows = save_gallery(snakemake.output[0], model, shown, space, Meshing(**wanted.meshing))
    log.info(
        "%d pictures of %d garments, %d of which have nothing left",
        len(rows),
        len({row["name"] for row in rows}),
        len({row["name"] for row in rows if not row["vertices"]}),
    )
