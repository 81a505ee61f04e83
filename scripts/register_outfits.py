"""Rule `register_outfits`: outfits at rest as offsets from the super-resolved body."""

from typing import TYPE_CHECKING

from drapeline.bodies.model import load_body
from drapeline.frames import GENDERS
from drapeline.outfits.static import load_static
from drapeline.registration.error_table import FILE_NAME, write_errors
from drapeline.registration.to_body.registrar import Registrar, register_shard
from drapeline.registration.to_body.topology import load_topology
from drapeline.rule_log import rule_log
from drapeline.storage import atomic_folder, save_npz

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with rule_log(snakemake.log[0]) as log:
    arrays, errors = register_shard(
        Registrar(load_topology(snakemake.input.topology)),
        load_static(snakemake.input.outfits),
        {gender: load_body(snakemake.input[gender]) for gender in GENDERS},
    )
    with atomic_folder(snakemake.output[0]) as folder:
        save_npz(folder / "offsets.npz", **arrays)
        write_errors(folder / FILE_NAME, errors)
    log.info("%d garments", len(arrays["garment"]))
