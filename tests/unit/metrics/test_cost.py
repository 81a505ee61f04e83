"""The table of what models take."""

import pytest

from drapeline.errors import InputError
from drapeline.metrics.cost import COST_FILE, Cost, read_costs, write_costs

CODE = Cost("representation", "svae", 0.25, 12, 800.5)
FIT = Cost("scan", "svae_scan", 3.5, 7, 901.0)


def rows(table):
    return [Cost(*row) for row in table.itertuples(index=False)]


def test_costs_of_all_evaluations_that_have_some_are_read_in_their_order(tmp_path):
    folders = [tmp_path / name for name in ("codes", "without", "fits")]
    for folder in folders:
        folder.mkdir()
    write_costs(folders[0], [CODE])
    write_costs(folders[2], [FIT, FIT._replace(variant="svae_scan_moved")])
    found = rows(read_costs(folders))
    assert found == [CODE, FIT, FIT._replace(variant="svae_scan_moved")]
    assert rows(read_costs(folders[1:2])) == rows(read_costs([])) == []


@pytest.mark.parametrize(
    ("costs", "message"),
    [
        ([CODE._replace(seconds=-1.0)], "seconds"),
        ([CODE, CODE], "representation"),
    ],
)
def test_a_cost_below_zero_and_one_that_is_there_twice_are_refused(tmp_path, costs, message):
    write_costs(tmp_path, [FIT])
    path = tmp_path / COST_FILE
    head = path.read_text().splitlines()[0]
    lines = ["\t".join(map(str, one)) for one in costs]
    path.write_text("\n".join([head, *lines]) + "\n")
    with pytest.raises(InputError, match=rf"{COST_FILE}.*{message}"):
        read_costs([tmp_path])
