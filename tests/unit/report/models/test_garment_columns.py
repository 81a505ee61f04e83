from drapeline.metrics.table import ALL, MetricRow
from drapeline.report.models.garment_columns import garment_columns

ROW = MetricRow("svae", "svae", "test", "Dress", "surface_error_mm", 12.5, "mm", 7, 0)


def test_types_have_one_order_whatever_the_order_of_rows():
    names = ("Trousers", ALL, "Skirt", "Dress", "Trousers", "Tshirt")
    rows = [ROW._replace(garment=name) for name in names]
    assert garment_columns(rows) == garment_columns(rows[::-1]) == ["Skirt", "Tshirt", "Trousers"]


def test_rows_over_all_types_alone_have_none():
    assert garment_columns([ROW._replace(garment=ALL)]) == []
