"""Posed bodies, beside `smplx`."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from side_by_side import Comparison, compare
from smplx.lbs import lbs

from drapeline.bodies.model import BodyModel, load_body, posed_vertices
from drapeline.frames import PARENTS

FRAMES = 300


def smplx_vertices(body: BodyModel, poses: np.ndarray) -> torch.Tensor:
    """All frames in one batch, which is the fastest way."""
    tensors = [torch.from_numpy(a) for a in (body.v_template, body.shapedirs)]
    posedirs = torch.from_numpy(np.ascontiguousarray(body.posedirs.reshape(-1, 207).T))
    parents = torch.from_numpy(PARENTS.astype(np.int64))
    regressor, weights = torch.from_numpy(body.J_regressor), torch.from_numpy(body.weights)
    shapes = torch.zeros(len(poses), 10)
    vertices, _ = lbs(
        shapes, torch.from_numpy(poses), *tensors, posedirs, regressor, parents, weights
    )
    return vertices


def rows(results: Path) -> Iterator[Comparison]:
    """Skinning with pose blend shapes (SMPL has them), and without (the free bodies)."""
    plain = load_body(results.parent / "resources/body/female.npz")
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 0.002, plain.posedirs.shape).astype(np.float32)
    poses = rng.normal(0, 0.3, (FRAMES, 72)).astype(np.float32)
    for body, text, goal in (
        (replace(plain, posedirs=noise), "with pose blend shapes", 2.0),
        (plain, "without", None),
    ):
        found = posed_vertices(body, np.zeros(10), poses)
        theirs = smplx_vertices(body, poses).numpy()
        theirs -= (body.J_regressor @ body.v_template)[0]
        np.testing.assert_allclose(found[0], theirs, atol=1e-5)
        yield compare(
            f"{FRAMES} posed bodies of {len(body.v_template):,} vertices, {text}",
            "`smplx`",
            lambda body=body: smplx_vertices(body, poses),
            lambda body=body: posed_vertices(body, np.zeros(10), poses),
            goal=goal,
        )
