"""That tests run as the environment asks for, and how portable ones are told from others."""

import json
import os
from types import SimpleNamespace

import pytest
import threadpoolctl
import torch

from portable import margins
from portable.margins import FILE, Margin
from portable.marks import portable_tests
from toys.threads import THREADS

MODULE = """
import pytest
import torch

def helper(x):
    return torch.ones(x)

@pytest.fixture
def network():
    return helper(2)

def test_by_what_it_calls(): helper(3)
def test_by_its_fixture(network): assert network
def test_by_a_comparison(): assert 1 == pytest.approx(1)
def test_by_a_threshold(): assert max([1]) < 2e-3
def test_by_a_rule(run_rule): run_rule("train_svae")
def test_by_a_fixture_of_its_folder(toy_network): assert toy_network
def test_of_whole_numbers(toy_body): assert max([1]) < 2

class TestThings: ...
"""


CONFTEST = """
@pytest.fixture
def toy_network(): train_posed()
"""


def test_portable_are_those_that_train_or_compare_floating_point_numbers(tmp_path, monkeypatch):
    monkeypatch.setattr("portable.marks._TESTS", tmp_path)
    (tmp_path / "room").mkdir()
    (tmp_path / "conftest.py").write_text(CONFTEST)
    path = tmp_path / "room" / "test_module.py"
    path.write_text(MODULE)
    names = ("by_what_it_calls", "by_its_fixture", "by_a_comparison", "by_a_threshold")
    names += ("by_a_rule", "by_a_fixture_of_its_folder")
    assert portable_tests(path) == {
        *("helper", "network", "toy_network"),
        *(f"test_{name}" for name in names),
    }


step_of_a_training = torch.optim.SGD([torch.zeros(1, requires_grad=True)], lr=0.1).step


def test_a_training_without_the_marker_fails(request):
    assert request.node.get_closest_marker("portable") is None
    with pytest.raises(pytest.fail.Exception, match="without the marker `portable`"):
        step_of_a_training()


def test_libraries_take_the_processor_that_the_environment_names():
    told = os.environ.get("ATEN_CPU_CAPABILITY")
    assert told is None or torch.backends.cpu.get_cpu_capability() == told.upper()
    assert torch.get_num_threads() == THREADS
    libraries = [x for x in threadpoolctl.threadpool_info() if x["internal_api"] == "openblas"]
    assert libraries
    kernels = os.environ.get("OPENBLAS_CORETYPE")
    # Before version 0.3.24 Prescott called itself by its predecessor's name.
    names = {"Prescott": {"Prescott", "Katmai"}}.get(kernels, {kernels})
    assert kernels is None or all(x["architecture"] in names for x in libraries)
    threads = os.environ.get("OPENBLAS_NUM_THREADS", os.environ.get("OMP_NUM_THREADS"))
    assert threads is None or all(x["num_threads"] == int(threads) for x in libraries)


def test_margins_are_the_least_distance_over_the_spread():
    rows = [("narrow", 0.7, 1), ("narrow", 0.9, 1), ("wide", 0.1, 1), ("wide", 0.2, 1)]
    rows += [("same", 0.999, 1), ("same", 0.999, 1)]
    lines = [json.dumps({"where": w, "value": v, "limit": limit}) for w, v, limit in rows]
    found = margins.margins(lines)
    assert [margin.where for margin in found] == ["narrow", "wide", "same"]
    assert [margin.ratio for margin in found] == pytest.approx([0.5, 8, float("inf")])
    assert found[0] == Margin("narrow", pytest.approx(0.1), pytest.approx(0.2))


@pytest.mark.parametrize(
    ("explanation", "value", "limit"),
    [
        ("0.25 < 0.5\n +  where 0.25 = f()", 0.25, 0.5),
        ("0.75 > 0.5", -0.75, -0.5),
        ("tensor(0.2500, dtype=torch.float64) <= (2 * tensor(0.5000, grad_fn=<A0>))", 0.25, 1.0),
        ("3 < 4", None, None),  # not floating-point numbers
        ("[0.1] < [0.2]", None, None),
        ("'a' < 'b'", None, None),
        ("0.25 == 0.25", None, None),
        ("f(0.25) < 0.5", None, None),
    ],
)
def test_assertions_are_recorded_that_compare_two_numbers(
    tmp_path, monkeypatch, explanation, value, limit
):
    monkeypatch.setenv(FILE, str(tmp_path / "comparisons"))
    (tmp_path / "comparisons").touch()
    margins.pytest_assertion_pass(SimpleNamespace(nodeid="test_a"), 7, explanation)
    rows = [json.loads(line) for line in (tmp_path / "comparisons").read_text().splitlines()]
    assert [(row["value"], row["limit"]) for row in rows] == [(value, limit)] * (value is not None)
