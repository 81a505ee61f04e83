import pytest

from drapeline.experiment.targets import explain_target

RULES = ["all", "dataset", "plot_health"]
PATTERNS = {
    "out/{table}.tsv": {"table": "metrics|scans"},
    "out/samples/{group}/{shard}": {"group": "learning|static", "shard": r"L00001|L00002"},
    "out/clips/{clip}/{length}.npz": {"clip": r"[^/]+", "length": r"whole|\d+"},
    "out/{model}/{model}.json": {"model": "svae|dvae"},
    "out/report.html": {},
}


@pytest.mark.parametrize(
    "target",
    [
        "dataset",
        "out/metrics.tsv",
        "out/samples/static/L00002",
        "out/clips/my walk/150.npz",
        "out/svae/svae.json",
    ],
)
def test_what_can_be_made_needs_no_explanation(target):
    assert explain_target(target, RULES, PATTERNS) == ""


@pytest.mark.parametrize(
    ("target", "meant"),
    [
        ("datset", "dataset"),
        ("out/reprt.html", "out/report.html"),
        ("report.html", "out/report.html"),
        ("out/metrics.png", "out/metrics.tsv"),
        ("out/samples/learnin/L00002", "out/samples/learning/L00002"),
        ("out/svae/dvae.json", "out/svae/svae.json"),
        ("out/clips/{clip}/hole.npz", "out/clips/{clip}/{length}.npz"),
    ],
)
def test_the_nearest_that_can_be_made_is_named(target, meant):
    found = explain_target(target, RULES, PATTERNS)
    assert found == f"nothing makes {target}; did you mean {meant}?"


def test_a_file_in_a_folder_that_is_made_as_a_whole_is_answered_with_the_folder():
    found = explain_target("out/samples/static/L00001/L00003/info.mat", RULES, PATTERNS)
    assert found.endswith("is made as a whole; ask for out/samples/static/L00001")


def test_what_is_like_nothing_is_just_refused():
    assert explain_target("zzz", RULES, PATTERNS) == "nothing makes zzz"
