from drapeline.report.models.sources import tables_by_source
from toys.metric_rows import metric_row


def table(rows):
    assert not any(row.source for row in rows)
    return [{"value": row.value} for row in rows]


def test_each_source_has_a_table_under_its_name():
    values = {"xpbd": 4.5, "": 3.5, "blender": 2.5}
    rows = [
        metric_row("posed", "all", "vertex_error_mm", value, source=source)
        for source, value in values.items()
    ]
    blender, first, xpbd, second = tables_by_source(rows, table)
    assert "blender" in blender
    assert "2.5" in first
    assert "xpbd" in xpbd
    assert "4.5" in second
    assert "3.5" not in first + second


def test_without_several_sources_there_is_nothing():
    assert tables_by_source([metric_row("posed", "all", "vertex_error_mm", 1.0)], table) == []
