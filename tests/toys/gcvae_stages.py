"""Everything that the training rules read, made of the toy body."""

from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel, save_body
from drapeline.bodies.rest_body import rest_body
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import vertex_normals
from drapeline.learning_data.static import collect_static
from drapeline.models.gcvae.settings import SVAE_VARIANTS
from drapeline.models.training.settings import override_settings
from drapeline.registration.to_body.hierarchy import build_hierarchy, level_counts, save_hierarchy
from drapeline.registration.to_body.super_body import build_super_body
from drapeline.registration.to_body.topology import build_topology, save_topology
from drapeline.seeding import rng_for
from drapeline.storage import save_npz

VERTICES = 1600
SETTINGS = {
    "network": {"widths": [6, 8, 8, 8, 8, 8], "features": 12, "latent": 6, "condition": 4},
    "loss": {"normals": 0.1},
    "training": {"steps": 4, "batch": 8, "seed": 0},
}


def write_stages(folder: Path, body: BodyModel) -> dict[str, Path]:
    """Body, topology, hierarchy and static data: inputs of `train_svae` by name."""
    refined = build_super_body({"female": body, "male": body}, VERTICES)
    topology = build_topology(refined)
    files = {name: folder / f"{name}.npz" for name in (*GENDERS, "topology", "hierarchy")}
    for gender in GENDERS:
        save_body(files[gender], refined.bodies[gender])
    save_topology(files["topology"], topology)
    save_hierarchy(
        files["hierarchy"], build_hierarchy(topology, "segments", level_counts(VERTICES))
    )
    save_npz(folder / "shard.npz", **_shard(refined.bodies["female"]))
    collect_static(folder / "data", [folder / "shard.npz"], refined.bodies)
    return {**files, "data": folder / "data"}


def _shard(body: BodyModel) -> dict[str, np.ndarray]:
    """Shells around the body, cut off at a height of their own."""
    rng, count = rng_for(0, "toy shard"), 20
    rest = rest_body(body, np.zeros(10))
    normals = vertex_normals(rest, body.faces)
    mask = rest[:, 2] > rng.uniform(-0.3, 0.1, (count, 1))
    offsets = rng.uniform(0.01, 0.04, (count, 1, 1)) * normals * mask[..., None]
    return {
        "offsets": offsets.astype(np.float32),
        "mask": mask,
        "shape": rng.uniform(-1, 1, (count, 10)).astype(np.float32),
        "gender": np.zeros(count, np.int8),
        "tightness": rng.uniform(-1, 0.5, (count, 2)).astype(np.float32),
        "garment": (np.arange(count) % 6).astype(np.int8),
        "outfit": np.array([f"s{row:05d}" for row in range(count)]),
        "split": np.array(["train"] * 14 + ["val"] * 4 + ["test"] * 2),
    }


def train_static(run_rule, files: dict[str, Path], folder: Path, variant: str = "svae") -> Path:
    """Run the rules that train or fit a static model; returns its folder."""
    if variant == "static_ppca":
        run_rule(
            "drapeline.models.gcvae.train:fit_static_ppca",
            input=files,
            output=[folder / variant],
            params={"settings": {"latent": 6, "seed": 0}, "code": "c"},
        )
        return folder / variant
    run_rule(
        "drapeline.models.gcvae.train:train_svae",
        input={**files, "conditioning": train_conditioning(run_rule, files, folder)},
        output=[folder / variant],
        params={
            "settings": override_settings(SETTINGS, SVAE_VARIANTS[variant]),
            "trainer": {"accelerator": "cpu"},
            "code": "c",
            "progress": str(folder / ".progress" / variant),
        },
    )
    return folder / variant


def train_conditioning(run_rule, files: dict[str, Path], folder: Path) -> Path:
    """Run `train_svae_conditioning`; returns its folder."""
    run_rule(
        "drapeline.models.gcvae.train:train_svae_conditioning",
        input={"data": files["data"]},
        output=[folder / "conditioning"],
        params={
            "settings": {"condition": 4, "training": {"steps": 4}},
            "trainer": {"accelerator": "cpu"},
            "code": "c",
            "progress": str(folder / ".progress" / "conditioning"),
        },
    )
    return folder / "conditioning"
