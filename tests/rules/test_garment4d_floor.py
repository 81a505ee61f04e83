"""Test garments of Garment4D that are simulated again, by a solver whose cloth follows the body."""

import numpy as np

from drapeline.bodies.model import save_body
from drapeline.dataset.point_clouds import write_clouds
from drapeline.dataset.settings import CloudSettings
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import triangulate
from drapeline.learning_data.sequence_sources import garments_in_samples
from drapeline.learning_data.sequences import collect_sequences
from drapeline.metrics.table import read_metrics
from drapeline.registration.to_template.remesh import RemeshTable
from drapeline.storage import save_npz
from toys.metric_rows import find_value
from toys.tiny_sample import write_tiny_sample


def test_test_garments_are_simulated_again(run_rule, toy_body, tmp_path):
    splits = {"00001": "train", "00002": "test", "00003": "train"}
    tiny = [write_tiny_sample(tmp_path, toy_body, *one) for one in splits.items()]
    mesh = tiny[0].meshes["Skirt"]
    every = np.arange(len(mesh.vertices))[:, None]
    corners = np.hstack([every, np.roll(every, 1), every])
    whole = np.tile(np.float32([1, 0, 0]), (len(every), 1))
    same, other = RemeshTable(corners, whole), RemeshTable(corners, whole[:, [1, 0, 2]])
    tables = {"00001": same, "00002": same, "00003": other}  # a space takes two garments
    (tmp_path / "fits").mkdir()
    save_npz(
        tmp_path / "fits/tables.npz",
        **{
            f"{name}/{key}": value
            for name, table in tables.items()
            for key, value in table._asdict().items()
        },
    )
    clouds = [tmp_path / "clouds" / name for name in splits]
    for one, folder in zip(tiny, clouds, strict=True):
        write_clouds(folder, one.folder, CloudSettings(points=50))
    bodies = {}
    for gender in GENDERS:
        bodies[gender] = tmp_path / f"{gender}.npz"
        save_body(bodies[gender], toy_body)
    samples = [one.folder for one in tiny]
    collect_sequences(
        tmp_path / "data",
        "Skirt",
        list(garments_in_samples("Skirt", samples, clouds, tables)),
        triangulate(mesh.faces),
        1,
        dict.fromkeys(GENDERS, toy_body),
    )
    run_rule(
        "drapeline.models.garment4d.floor:evaluate_floor",
        input={
            **bodies,
            "Skirt": tmp_path / "data",
            "fits_Skirt": [tmp_path / "fits"],
            "samples": [tmp_path / "samples"],
            "outfits": [tmp_path / "outfits"],
            "motions": [tmp_path / "bodies"],
        },
        output=[tmp_path / "floor"],
        params={
            "solver": "toys.cloth",
            "garments": ["Skirt"],
            "samples": ["00001", "00002"],  # the first is of another split
            "split": "test",
            "seed": 0,
        },
    )
    rows = read_metrics(tmp_path / "floor/metrics.tsv")
    assert {(row.model, row.variant) for row in rows.itertuples()} == {
        ("garment4d", "again_other_solver")
    }
    error = find_value(rows, "again_other_solver", "test", "Skirt", "vertex_error_mm")
    assert error.n == 1
    assert error.value > 0
