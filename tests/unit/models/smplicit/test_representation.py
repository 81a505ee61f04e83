import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.cost import Cost, read_costs, write_costs
from drapeline.metrics.table import ALL, METRICS_FILE, read_metrics
from drapeline.models.contract import HeldOutGarment
from drapeline.models.smplicit.representation import (
    HELD_OUT,
    FieldCode,
    HeldOut,
    compare_codes,
    save_held_out,
)
from drapeline.outfits.garment_types import GARMENTS
from toys.jobs import job_of
from toys.metric_rows import find_value
from toys.outfits_at_rest import save_static
from toys.pictured import save_registered
from toys.smplicit import toy_outfits, tube

NONE = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))


def test_codes_and_surfaces_are_those_of_the_files(tmp_path):
    sheets = {"Top": tube(0.3, -0.5, 0.0), "Skirt": tube(0.3, -0.5, 0.0, around=12)}
    for number, (garment, sheet) in enumerate(sheets.items(), 1):
        held_out = HeldOut(
            np.array([f"s{number}"]),
            np.array([GARMENTS.index(garment)], np.int8),
            np.zeros((1, 2 + number), np.float32),
            [sheet],
        )
        save_held_out(tmp_path / f"{garment}.npz", held_out)
    code = FieldCode("smplicit_64", [tmp_path / "Top.npz", tmp_path / "Skirt.npz"])
    assert code.variant == "smplicit_64"
    asked = [HeldOutGarment(0, "s2", "Skirt", NONE), HeldOutGarment(1, "s1", "Top", NONE)]
    found = [len(mesh.faces) for mesh in code.rebuild(asked)]
    assert found == [len(sheets["Skirt"].faces), len(sheets["Top"].faces)]
    assert code.code_numbers("Top") == 3
    assert code.code_numbers("Skirt") == 4
    assert code.code_numbers("Dress") is None


def save_evaluated(folder, garments, cost):
    """What the evaluation of a model leaves of held-out skirts, and of none."""
    folder.mkdir()
    held_out = HeldOut(
        np.array([name for name, _ in garments], dtype=np.str_),
        np.full(len(garments), GARMENTS.index("Skirt"), np.int8),
        np.zeros((len(garments), 5), np.float32),
        [mesh for _, mesh in garments],
    )
    save_held_out(folder / HELD_OUT, held_out)
    write_costs(folder, [cost])


def test_what_codes_of_several_models_take_is_the_mean_over_their_garments(tmp_path, toy_body):
    """Each garment counts the same, whichever model its code is of; sizes of codes are apart."""
    save_registered(tmp_path / "data", toy_body)
    save_static(tmp_path / "outfits", toy_outfits())
    skirts = [(one.name, one.outfit.garments[0]) for one in toy_outfits() if one.split == "test"]
    exact = [(name, Mesh(skirt.vertices, skirt.faces)) for name, skirt in skirts]
    for folder, garments, seconds, count, megabytes in (
        ("skirt", exact, 2.0, 3, 700.0),
        ("upper", [], 10.0, 1, 900.0),
        ("skirt_18", exact, 0.5, 2, 800.0),
    ):
        cost = Cost("representation", folder, seconds, count, megabytes)
        save_evaluated(tmp_path / folder, garments, cost)
    given = {
        "smplicit": [tmp_path / "skirt", tmp_path / "upper"],
        "smplicit_18": [tmp_path / "skirt_18"],
        "data": tmp_path / "data",
        "outfits": [tmp_path / "outfits"],
    }
    variants = ["smplicit", "smplicit_18"]
    told = {"variants": variants, "garments": ["Skirt"], "split": "test", "seed": 0}
    compare_codes(job_of(given, tmp_path / "compared", **told))
    found = [Cost(*row) for row in read_costs([tmp_path / "compared"]).itertuples(index=False)]
    assert found == [
        Cost("representation", "smplicit", (3 * 2.0 + 1 * 10.0) / 4, 4, 900.0),
        Cost("representation", "smplicit_18", 0.5, 2, 800.0),
    ]
    rows = read_metrics(tmp_path / "compared" / METRICS_FILE)
    for variant in variants:
        row = find_value(rows, variant, "test", ALL, "surface_to_true_mm")
        assert (row.n, abs(row.value) < 1e-3) == (len(skirts), True)
