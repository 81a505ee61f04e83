"""Faults that `make mutants` plants: what they are, where, and which are drawn."""

import pytest

from mutants.operators import mutants
from mutants.run import drawn_mutants

TOY = '''"""Toy."""
from math import floor

LIMIT: int = 3


def clipped(x: float, low=0.5, *, high=LIMIT):
    """A number within limits, such as 1 and 2."""
    if not x >= low and x != high:
        raise ValueError(f"{x + 1} is under {low}")
    values = [0] * floor(x)
    values[0] -= len(values)
    values.append(min(x, high))
    return x  # ü, 2 - 1


class Box:
    size = 1.0

    def grown(self, by):
        for _ in range(by):
            if by - 1 > self.size:
                continue
            self.size = self.size @ by if by else -by
        return self.larger(by, self.size, copy=True)
'''


@pytest.fixture(scope="module")
def planted():
    return {
        (name, mutant.before, mutant.after)
        for name, found in mutants(TOY).items()
        for mutant in found
    }


@pytest.mark.parametrize(
    "fault",
    [
        ("", "3", "4"),
        ("clipped", "0.5", "1.0"),
        ("clipped", "x != high", "x == high"),
        ("clipped", "not x >= low", "x >= low"),
        ("clipped", "x >= low", "x > low"),
        ("clipped", "not x >= low and x != high", "not x >= low or x != high"),
        ("clipped", "[0] * floor(x)", "[0] / floor(x)"),
        ("clipped", "floor(x)", "ceil(x)"),
        ("clipped", "values[0] -= len(values)", "pass"),
        ("clipped", "values.append(min(x, high))", "pass"),
        ("clipped", "min(x, high)", "max(x, high)"),
        ("clipped", "return x", "return None"),
        ("Box", "1.0", "2.0"),
        ("Box.grown", "by - 1", "1 - by"),
        ("Box.grown", "by - 1", "by + 1"),
        ("Box.grown", "continue", "pass"),
        ("Box.grown", "self.size @ by", "by @ self.size"),
        ("Box.grown", "self.size @ by if by else -by", "-by if by else self.size @ by"),
        ("Box.grown", "True", "False"),
        (
            "Box.grown",
            "self.larger(by, self.size, copy=True)",
            "self.larger(self.size, by, copy=True)",
        ),
        ("Box.grown", "self.larger(by, self.size, copy=True)", "self.larger(by, self.size)"),
    ],
)
def test_the_operators_plant(planted, fault):
    assert fault in planted


def test_nothing_is_planted_where_no_test_should_look(planted):
    assert not [fault for fault in planted if "is under" in fault[1] or "Toy" in fault[1]]
    assert ("clipped", "2", "3") not in planted  # in a comment and in a docstring
    assert ("clipped", "x + 1", "x - 1") not in planted  # in an error's sentence


def test_a_mutant_changes_one_line_of_the_text():
    for found in mutants(TOY).values():
        for mutant in found:
            pairs = zip(TOY.splitlines(), mutant.text.splitlines(), strict=True)
            changed = [k for k, (old, new) in enumerate(pairs, start=1) if old != new]
            assert changed == [mutant.line]


def test_parentheses_keep_a_swap_together():
    texts = {m.text for m in mutants("y = 2 * (a + b) ** 2\n")[""]}
    assert "y = 2 * ((a - b)) ** 2\n" in texts
    assert "y = (2 / (a + b) ** 2)\n" in texts


def test_functions_are_drawn_by_a_seed_each_before_any_is_drawn_twice(tmp_path):
    file = tmp_path / "toy.py"
    file.write_text(TOY)
    drawn = list(drawn_mutants([file], None, 8, seed=0))
    assert drawn == list(drawn_mutants([file], None, 8, seed=0))
    assert drawn != list(drawn_mutants([file], None, 8, seed=1))
    assert {mutant.place for _, mutant in drawn[:4]} == {"", "clipped", "Box", "Box.grown"}
    (line,) = (k for k, text in enumerate(TOY.splitlines(), start=1) if "self.larger" in text)
    some = [m for _, m in drawn_mutants([file], {file: {line}}, 99, seed=0)]
    assert some
    assert {m.line for m in some} == {line}
    assert len(set(some)) == len(some)
