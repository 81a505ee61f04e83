"""Figures of Garment4D that its own code is needed for."""

import numpy as np

from drapeline.bodies.model import load_bodies, posed_vertices
from drapeline.dataset.record import SPLITS
from drapeline.job import Job
from drapeline.learning_data.sequences import SequenceData
from drapeline.models.garment4d.data import BodySequences, BodySet, propose_garment
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.garment4d.figures import SkinnedTwice, plot_neighbours

_ROWS = 2
_HIP_AND_KNEE = slice(3, 18)  # what pulls a skirt apart


def plot_skinning(job: Job) -> None:
    """A garment skinned to the nearest vertex and to many, as figure 7 of the paper."""
    bodies = load_bodies(job.input)
    data = SequenceData(job.input.data)
    sequences = BodySequences(data, BodySet(bodies, 1))
    many = SkinningSettings(**job.params.skinning)
    cases = []
    order = [row for split in reversed(SPLITS) for row in data.of_split(split)]
    # Simulated samples first; the sort keeps the order of the splits.
    for sequence in sorted(order, key=lambda row: data.source[row] != "simulated")[:_ROWS]:
        poses = data.poses[data.rows(sequence)]
        frame = int(np.abs(poses[:, _HIP_AND_KNEE]).sum(axis=1).argmax())
        body, worn = sequences.body(sequence), data.canonical[sequence]
        nearest, interpolated = (
            propose_garment(body, poses[frame][None], worn, data.space.faces, how)[0]
            for how in (many.replace(neighbours=1, passes=0), many)
        )
        vertices = posed_vertices(body.model, body.shape, poses[frame][None])[0][0]
        cases.append(
            SkinnedTwice(
                f"{data.name[sequence]}\nframe {data.number[data.rows(sequence)][frame]}",
                data.garment_type,
                worn,
                data.space.faces,
                nearest,
                interpolated,
                vertices,
                body.model.faces,
                float(-vertices[:, 2].min()),
            )
        )
    with ray_share(job.params.rays):
        plot_neighbours(job.output[0], cases, many.neighbours)
