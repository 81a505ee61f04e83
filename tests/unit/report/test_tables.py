"""Tables of metrics: intervals, the best, and a paper's numbers in columns of their own."""

import pytest

from drapeline.metrics.table import HIGH, LOW, write_metrics
from drapeline.report.tables import (
    MEAN_OF_TYPES,
    MetricTable,
    Section,
    printed,
    read_test_metrics,
    with_mean_of_types,
    write_beside_paper,
    write_sections,
)
from toys.metric_rows import metric_row, metric_table

ERROR = "vertex_error_mm"


@pytest.fixture
def read(tmp_path):
    """read(rows, models) -> the rows of the test split"""

    def write(*rows, models=()):
        write_metrics(tmp_path / "metrics.tsv", metric_table(rows))
        return read_test_metrics(tmp_path / "metrics.tsv", models)

    return write


def texts(rows):
    return [[str(cell) for cell in row.values()] for row in rows]


def good(row):
    return {title for title, cell in row.items() if "good" in getattr(cell, "classes", ())}


def test_rows_have_the_order_asked_for_and_intervals_where_they_are_known(read):
    measured = read(
        metric_row("posed", "Skirt", ERROR, 27.125),
        metric_row("posed", "Skirt", ERROR + LOW, 20.0),
        metric_row("posed", "Skirt", ERROR + HIGH, 35.5),
        metric_row("lbs", "Skirt", ERROR, 41.0),
        metric_row("lbs", "Tshirt", ERROR, 19.0, n=3),
        metric_row("lbs", "Skirt", ERROR, 99.0, split="val"),
        metric_row("mgn", "Skirt", ERROR, 98.0),
    )
    table = MetricTable(["lbs", "posed"], [ERROR], ("Skirt", "Tshirt", "Dress"), across="garment")
    rows = table.rows(measured)
    assert list(rows[0]) == ["Model", "Skirt", "T-shirt", "Garments"]
    assert texts(rows) == [
        ["Interpolated skinning", "41.0", "19.0", "5 / 3"],
        ["Garment4D, posed stage", "27.1 [20.0, 35.5]", "-", "5 / -"],
    ]


def test_the_best_of_a_column_is_marked_where_two_or_more_compete(read):
    measured = read(
        metric_row("truth", "all", "inside_share", 0.001),
        metric_row("lbs", "all", "inside_share", 0.02),
        metric_row("posed", "all", "inside_share", 0.01),
        metric_row("posed", "all", "inside_depth_mm", 4.0),
        metric_row("lbs", "all", "segmentation_accuracy", 0.9),
        metric_row("posed", "all", "segmentation_accuracy", 0.8),
        metric_row("lbs", "all", "pieces", 1.0),
        metric_row("posed", "all", "pieces", 2.0),
    )
    metrics = ["inside_share", "inside_depth_mm", "segmentation_accuracy", "pieces"]
    table = MetricTable(["truth", "lbs", "posed"], metrics)
    truth, lbs, posed = table.rows(measured)
    assert good(truth) == set()  # nothing competes with it
    assert good(lbs) == {"Right labels (%)"}
    assert good(posed) == {"Inside the body (%)"}
    # Two of two are alike: none leads.
    alike = [metric_row(name, "all", ERROR, 5.0) for name in ("lbs", "posed")]
    assert not any(map(good, MetricTable(["lbs", "posed"], [ERROR]).rows(read(*alike))))
    unmarked = MetricTable(["lbs", "posed"], metrics, best=False)
    assert not any(map(good, unmarked.rows(measured)))


def test_what_is_compared_within_a_group_leads_within_it(read):
    values = {"upper_fitted": 3.0, "upper_mean_code": 9.0, "skirt_fitted": 4.0}
    measured = read(
        *(
            metric_row(f"smplicit_{name}", "all", "surface_to_true_mm", value, model="smplicit")
            for name, value in (values | {"skirt_mean_code": 8.0}).items()
        )
    )
    names = [f"smplicit_{name}" for name in (*values, "skirt_mean_code")]
    rows = MetricTable(names, ["surface_to_true_mm"]).rows(measured)
    assert [(row["Group"], row["Model"]) for row in rows[1:3]] == [
        ("Upper body: t-shirts and tops", "SMPLicit, mean code"),
        ("Skirts", "SMPLicit, fitted code"),
    ]
    assert [bool(good(row)) for row in rows] == [True, False, True, False]


def test_a_papers_numbers_stand_in_columns_of_their_own(read):
    measured = read(
        metric_row("posed", "Skirt", ERROR, 27.0), metric_row("ours", "Skirt", ERROR, 7.0)
    )
    theirs = printed(
        "garment4d",
        {("posed", "Skirt"): {ERROR: 49.39}, ("mgn", "Skirt"): {ERROR: 71.66, "pieces": None}},
    )
    table = MetricTable(
        ["mgn", "posed", "ours"], [ERROR], ["Skirt"], across="garment", printed=theirs, paper="P"
    )
    rows = table.rows(measured)
    assert [(str(row["Skirt"]), str(row["Skirt, P"])) for row in rows] == [
        ("-", "71.66"),
        ("27.0", "49.39"),
        ("7.0", "-"),
    ]
    assert all("theirs" in row["Skirt, P"].classes for row in rows)
    assert [good(row) for row in rows] == [set(), set(), {"Skirt"}]


def test_what_a_paper_alone_has_measured_is_in_no_table_of_a_solver(read, tmp_path):
    theirs = printed("garment4d", {("mgn", "all"): {ERROR: 71.66}})
    table = MetricTable(["mgn", "posed"], [ERROR], printed=theirs, paper="P")
    measured = read(
        *(metric_row("posed", "all", ERROR, 1.0, source=name) for name in ("", "blender", "xpbd"))
    )
    write_sections(tmp_path / "p.html", "T", [], [Section("E", table, by_source=True)], measured)
    assert (tmp_path / "p.html").read_text().count("71.66") == 1


def test_variants_with_a_number_rise(read):
    rows = [metric_row(f"neighbours_{k}", "all", ERROR, 1.0) for k in (16, 4, 256)]
    found = MetricTable(["neighbours_*"], [ERROR]).rows(read(*rows))
    assert [row["Model"] for row in found] == ["K = 4", "K = 16", "K = 256"]


def test_the_mean_of_types_weighs_them_alike(read):
    measured = read(
        metric_row("posed", "Skirt", ERROR, 10.0, n=90),
        metric_row("posed", "Tshirt", ERROR, 20.0, n=10),
        metric_row("posed", "all", ERROR, 11.0, n=100),
    )
    table = MetricTable(["posed"], [ERROR], [MEAN_OF_TYPES, "all"], across="garment")
    (row,) = table.rows(with_mean_of_types(measured))
    assert (row[MEAN_OF_TYPES], row["All"]) == ("15.0", "11.0")


def test_samples_of_each_solver_have_a_table_and_do_not_change_the_others(read, tmp_path):
    values = {"": 12.0, "blender": 34.0, "xpbd": 56.0}
    rows = [metric_row("posed", "all", ERROR, value, source=s) for s, value in values.items()]
    section = Section("Errors", MetricTable(["posed"], [ERROR]), "About.", "Below.", by_source=True)
    write_sections(tmp_path / "page.html", "Title", ["First."], [section], read(*rows))
    page = (tmp_path / "page.html").read_text()
    common, _, rest = page.partition("<h3>On the samples of blender alone</h3>")
    blender, _, xpbd = rest.partition("<h3>On the samples of xpbd alone</h3>")
    assert [part.count(">12.0<") for part in (common, blender, xpbd)] == [1, 0, 0]
    assert [part.count(">34.0<") for part in (common, blender, xpbd)] == [0, 1, 0]
    assert [part.count(">56.0<") for part in (common, blender, xpbd)] == [0, 0, 1]
    assert page.index("First.") < page.index("About.") < page.index("Below.")


def test_rows_may_be_of_each_solver(read):
    rows = [metric_row("posed", "all", ERROR, 1.0, source=name) for name in ("", "xpbd")]
    table = MetricTable(["posed"], [ERROR], down=("source", "metric", "variant"))
    (row,) = table.rows(read(*rows))
    assert (row["Samples"], row["Measure"]) == ("Xpbd", "Vertex error (mm)")
    (row,) = MetricTable(["posed"], [ERROR], across="source").rows(read(*rows))
    assert list(row) == ["Model", "Xpbd", "Garments"]


def test_other_models_are_left_out(read):
    rows = [
        metric_row("posed", "all", ERROR, 1.0),
        metric_row("svae", "all", ERROR, 2.0, model="x"),
    ]
    assert read(*rows, models=["garment4d"])["variant"].tolist() == ["posed"]


def test_our_numbers_and_a_papers_are_two_columns_of_a_file(read, tmp_path):
    measured = read(
        metric_row("posed", "Skirt", ERROR, 27.125),
        metric_row("posed", "Skirt", ERROR, 88.0, source="xpbd"),
    )
    theirs = printed(
        "garment4d", {(n, "Skirt"): {ERROR: v} for n, v in (("posed", 49.39), ("mgn", 7))}
    )
    write_beside_paper(tmp_path / "beside.tsv", measured, {"3": theirs})
    assert (tmp_path / "beside.tsv").read_text().splitlines() == [
        "table\tmodel\tvariant\tgarment\tmetric\tours\ttheirs",
        "3\tgarment4d\tposed\tSkirt\tvertex_error_mm\t27.125\t49.39",
        "3\tgarment4d\tmgn\tSkirt\tvertex_error_mm\t\t7",
    ]
