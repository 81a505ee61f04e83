import re

from drapeline.metrics.table import HIGH, LOW, write_metrics
from drapeline.report.models.smplicit.tables import write_smplicit_page
from toys.metric_rows import metric_row, metric_table


def row(variant, metric, value, **changes):
    garment = changes.pop("garment", "all")
    return metric_row(variant, garment, metric, value, **{"model": "smplicit", **changes})


def test_every_number_is_where_it_belongs(tmp_path):
    write_metrics(
        tmp_path / "metrics.tsv",
        metric_table(
            [
                row("smplicit_skirt_fitted", "surface_to_true_mm", 6.25),
                row("smplicit_skirt_fitted", "surface_to_true_mm" + LOW, 5.0),
                row("smplicit_skirt_fitted", "surface_to_true_mm" + HIGH, 7.5),
                row("smplicit_skirt_fitted", "openings_right", 0.95),
                row("smplicit_skirt_fitted", "surface_to_true_mm", 77.0, garment="Skirt"),
                row("smplicit_skirt_constant", "field_near_mm", 8.125),
                row("smplicit_upper_fitted", "walls_to_true_mm", 9.0),
                row("smplicit_images_fitted", "silhouette_iou", 0.83),
                row("smplicit_images_nearest", "surface_to_true_mm", 31.2),
                row("posed", "surface_to_true_mm", 88.0, model="garment4d"),
            ]
        ),
    )
    write_smplicit_page(tmp_path / "page.html", tmp_path / "metrics.tsv")
    page = (tmp_path / "page.html").read_text()
    open_surface, walls, fields, pictures = re.findall(r"<tbody>(.*?)</tbody>", page, re.DOTALL)
    assert "6.2 <small>[5.0, 7.5]</small>" in open_surface
    assert re.search(r">95<", open_surface)
    assert "9.0" in walls
    assert "Upper body" in walls
    assert "8.12" in fields
    assert "Median distance" in fields
    assert "Median distance" not in open_surface
    assert ">0.83<" in pictures
    assert re.search(r"Training code with the least loss.*>31<", pictures, re.DOTALL)
    assert "Training code" not in open_surface
    assert "77.0" not in page
    assert "88.0" not in page


def test_pictures_of_several_solvers_have_tables_of_their_own(tmp_path):
    values = {"": 0.5, "blender": 0.6, "xpbd": 0.4}
    rows = [
        row("smplicit_images_fitted", "silhouette_iou", value, source=name)
        for name, value in values.items()
    ]
    write_metrics(tmp_path / "metrics.tsv", metric_table(rows))
    write_smplicit_page(tmp_path / "page.html", tmp_path / "metrics.tsv")
    page = (tmp_path / "page.html").read_text()
    tables = re.findall(r"<tbody>(.*?)</tbody>", page, re.DOTALL)
    assert [re.findall(r">(0.\d+)<", table)[-1] for table in tables] == ["0.50", "0.60", "0.40"]
    assert page.index("samples of blender alone") < page.index("samples of xpbd alone")


def test_nothing_measured_is_said(tmp_path):
    write_metrics(tmp_path / "metrics.tsv", metric_table([]))
    write_smplicit_page(tmp_path / "page.html", tmp_path / "metrics.tsv")
    assert (tmp_path / "page.html").read_text().count("<p>None.</p>") == 4
