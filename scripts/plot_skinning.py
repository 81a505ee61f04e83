"""Rule `plot_skinning`: figure 7, what interpolated skinning weights do for a skirt."""

from typing import TYPE_CHECKING

import numpy as np

from drapeline.bodies.model import load_body, posed_vertices
from drapeline.dataset.splits import SPLITS
from drapeline.frames import GENDERS
from drapeline.learning_data.sequences import SequenceData
from drapeline.models.garment4d.data import BodySequences, BodySet, propose_garment
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.garment4d.figures import SkinnedTwice, plot_neighbours
from drapeline.rule_log import rule_log

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

_ROWS = 2
_HIP_AND_KNEE = slice(3, 18)  # what pulls a skirt apart

with rule_log(snakemake.log[0]), ray_share(snakemake.params.rays):
    bodies = {gender: load_body(snakemake.input[gender]) for gender in GENDERS}
    data = SequenceData(snakemake.input.data)
    sequences = BodySequences(data, BodySet(bodies, 1))
    many = SkinningSettings(**snakemake.params.skinning)
    cases = []
    order = [row for split in reversed(SPLITS) for row in data.of_split(split)]
    # Simulated samples first; the sort keeps the order of the splits.
    for sequence in sorted(order, key=lambda row: data.source[row] != "simulated")[:_ROWS]:
        poses = data.poses[data.rows(sequence)]
        frame = int(np.abs(poses[:, _HIP_AND_KNEE]).sum(axis=1).argmax())
        body, worn = sequences.body(sequence), data.canonical[sequence]
        posed = [
            propose_garment(body, poses[frame][None], worn, data.space.faces, how)[0]
            for how in (many.replace(neighbours=1, passes=0), many)
        ]
        vertices = posed_vertices(body.model, body.shape, poses[frame][None])[0][0]
        cases.append(
            SkinnedTwice(
                f"{data.name[sequence]}\nframe {data.number[data.rows(sequence)][frame]}",
                data.garment_type,
                worn,
                data.space.faces,
                *posed,
                vertices,
                body.model.faces,
                float(-vertices[:, 2].min()),
            )
        )
    plot_neighbours(snakemake.output[0], cases, many.neighbours)
