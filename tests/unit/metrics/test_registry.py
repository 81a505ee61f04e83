"""Metrics and variants by name, also those of a package that is not ours."""

import sys
from importlib.metadata import EntryPoint
from types import ModuleType

import pytest

import drapeline.metrics.garment4d as garment4d
import drapeline.metrics.gcvae as gcvae
import drapeline.metrics.shared as shared
import drapeline.metrics.smplicit as smplicit
from drapeline.metrics import registry
from drapeline.metrics.metric import LARGER, Metric, Variant


@pytest.mark.parametrize(
    ("metric", "heading", "text"),
    [
        (Metric("mm", "Error"), "Error (mm)", "1.2"),
        (Metric("%", "Share", 0, 100), "Share (%)", "123"),
        (Metric("ms", "Time", 0, 1000), "Time (ms)", "1234"),
        (Metric("m/s²", "Acceleration", 2), "Acceleration (m/s²)", "1.23"),
        (Metric("", "Pieces", 3), "Pieces", "1.234"),
    ],
)
def test_a_metric_is_shown_in_its_unit_and_digits(metric, heading, text):
    assert metric.heading == heading
    assert metric.text(1.234) == text


def test_an_interval_stands_behind_the_value_in_the_same_unit():
    assert Metric("%", "Share", 1, 100).text(0.5, 0.25, 0.75) == "50.0 [25.0, 75.0]"


def test_what_several_models_share_is_declared_once():
    modules = (shared, gcvae, garment4d, smplicit)
    names = [name for module in modules for name in module.METRICS]
    assert len(set(names)) == len(names)
    keys = [
        (model, name)
        for module in modules
        for model in module.VARIANTS
        for name in module.VARIANTS[model]
    ]
    assert len(set(keys)) == len(keys)


def test_names_that_nobody_declared_are_their_own_titles():
    assert registry.metric("no_metric_mm").heading == "no_metric_mm"
    assert registry.variant("svae", "no_variant") == Variant("no_variant")


def test_a_star_stands_for_what_differs():
    assert registry.variant("garment4d", "neighbours_16").title == "K = 16"
    assert registry.variant("garment4d", "neighbours") == Variant("neighbours")


@pytest.mark.parametrize("model", ["clean_scan", "worse_scan"])
def test_cleaner_and_worse_scans_have_the_variants_of_scans(model):
    assert registry.variants(model) == registry.variants("scan") != {}
    for name, one in registry.variants("scan").items():
        assert registry.variant(model, name) == one


def test_models_that_share_the_name_of_a_variant_keep_their_titles():
    assert registry.variant("baseline", "pca").title == "PCA of offsets"
    assert not registry.variant("garment4d", "pca").competes


@pytest.fixture
def stranger(monkeypatch):
    """A package with a model of its own, which names its metrics as an entry point."""
    module = ModuleType("stranger_metrics")
    module.METRICS = {"fold_iou": Metric("", "Folds", 2, better=LARGER)}
    module.VARIANTS = {"stranger": {"best": Variant("Stranger's best")}}
    monkeypatch.setitem(sys.modules, "stranger_metrics", module)
    point = EntryPoint("stranger", "stranger_metrics", registry.ENTRY_POINTS)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point])
    registry._modules.cache_clear()
    yield module
    registry._modules.cache_clear()


def test_a_package_that_is_not_ours_adds_its_own(stranger):
    assert registry.metric("fold_iou") == stranger.METRICS["fold_iou"]
    assert registry.metric("surface_error_mm").unit == "mm"
    assert list(registry.variants("stranger")) == ["best"]
    assert registry.variant("stranger", "best").title == "Stranger's best"
