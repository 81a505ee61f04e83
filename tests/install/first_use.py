"""What someone does first with drapeline installed, and the files for it."""

import shutil
from pathlib import Path

from drapeline.bodies.model import save_body
from toys.bodies import toy_body
from toys.gcvae_files import TypedGarments, save_model
from toys.tiny_sample import write_tiny_sample

ROOT = Path(__file__).parents[2]
# Arguments: a folder of samples, a body.
READ = """
import sys, warnings
warnings.simplefilter("error")
import drapeline
folder, body = sys.argv[1:]
data = drapeline.open_dataset(folder, bodies=dict.fromkeys(("female", "male"), body))
with data[0] as sample:
    assert sample.vertices("Skirt", 0, 2).shape == (2, 80, 3)
    assert sample.mesh("Skirt").triangles.shape[1] == 3
    assert sample.body_vertices(1, 2).shape[0] == 1
"""
# Arguments of Python that dress somebody, and of one that measures it.
DRESS = ("-m", "drapeline", "dress", ROOT / "examples/data/jump.bvh", "--frames", "3")
# Arguments: a folder of samples, a trained model.
TORCH = """
import sys
import drapeline
from drapeline.torch import FrameDataset, make_loader
folder, model = sys.argv[1:]
(batch,) = make_loader(FrameDataset(drapeline.open_dataset(folder)), 99, seed=0)
assert set(batch.garment) == {"Skirt", "Tshirt"}
(garment,) = drapeline.load(model).sample(1)
assert len(garment.body.faces)
for name in drapeline.__all__:
    getattr(drapeline, name)
"""
# No arguments.
PIPELINE = """
import bpy, snakemake
import drapeline.blender.solver, drapeline.models.training.lightning
"""


def copy_library(folder: Path) -> Path:
    """Copy all that pip installs, so that it builds outside the checkout."""
    shutil.copytree(ROOT / "src" / "drapeline", folder / "src" / "drapeline")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    return folder


def write_files(folder: Path) -> dict[str, Path]:
    """Write a sample, a body and a trained model; returns where they are."""
    body = toy_body()
    tiny = write_tiny_sample(folder, body)
    save_model(folder / "model", garments=TypedGarments())
    save_body(folder / "body.npz", body)
    return {"samples": tiny.folder.parent, "model": folder / "model", "body": folder / "body.npz"}
