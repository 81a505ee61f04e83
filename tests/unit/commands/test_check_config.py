import pytest

from drapeline.commands.check_config import run
from drapeline.errors import InputError


class Given:
    def __init__(self, *files):
        self.files = list(map(str, files))


def test_a_config_is_checked_and_its_samples_counted(tmp_path, monkeypatch, capsys):
    (tmp_path / "clips.tsv").write_text("sequence\tfile\taction\nwalk\tresources/walk.npz\twalk\n")
    (tmp_path / "a.yaml").write_text("groups:\n  dataset:\n    count: 0\nseed: 3\n")
    (tmp_path / "b.yaml").write_text("groups:\n  static:\n    count: 7\n    test_share: 0\n")
    monkeypatch.chdir(tmp_path)
    assert run(Given("a.yaml", "b.yaml")) == 0
    out = capsys.readouterr().out
    assert "a.yaml + b.yaml: 4 settings, each in range" in out


def test_an_empty_config_is_the_default(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.yaml").write_text("# nothing yet\n")
    assert run(Given("empty.yaml")) == 0
    assert "0 settings" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("body:\n  bmi_rnge: [1, 2]\n", "'body.bmi_rnge' is not a setting, did you mean bmi_range"),
        ("seed: many\n", "seed is 'many', expected an integer of at least 0"),
        ("- 1\n", "is list, expected settings"),
        ("a: [\n", "not readable as YAML"),
        ("seed: !!python/object/apply:os.system ['touch ran']\n", "not readable as YAML"),
        ("body:\n  bmi_range: [30, 20]\n", "expected the lower end first"),
        ("__use_yte__: true\nseed: 3\n", "has __use_yte__, with which Snakemake runs Python"),
        ("# " + 1_000_001 * "x", "bytes, expected YAML of at most 1,000,000"),
    ],
)
def test_a_config_that_a_workflow_refuses_is_one_sentence(tmp_path, monkeypatch, text, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(InputError, match=message):
        run(Given("mine.yaml"))
    assert not (tmp_path / "ran").exists()
