"""The table of mutants keeps up with the code; `make mutants` says which of them tests notice."""

import pytest

from mutants.table import load_mutants

MUTANTS = load_mutants()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda m: f"{m.file}: {m.breaks}")
def test_a_mutant_can_be_planted_and_has_tests_to_notice_it(mutant):
    mutant.applied()
    assert mutant.test_files()


def test_there_are_many_and_no_two_are_alike():
    assert len(MUTANTS) >= 60
    assert len({(m.file, m.text, m.put) for m in MUTANTS}) == len(MUTANTS)
    assert len({m.breaks for m in MUTANTS if "weights of equation" not in m.breaks}) > 60
