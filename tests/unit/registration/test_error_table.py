"""The table of registration errors."""

from drapeline.registration.error_table import COLUMNS, Measure, error_rows, write_errors


def test_each_measure_of_a_garment_is_a_row_with_six_digits(tmp_path):
    measures = [Measure("distance_mm", 1.23456789, "mm"), Measure("holes", 3, "count")]
    write_errors(tmp_path / "errors.tsv", error_rows("Skirt", "00001", measures))
    assert (tmp_path / "errors.tsv").read_text().splitlines() == [
        "\t".join(COLUMNS),
        "Skirt\t00001\tdistance_mm\t1.23457\tmm",
        "Skirt\t00001\tholes\t3\tcount",
    ]
