"""One version everywhere: `--version`, the citation, the changelog's latest release."""

import re
from pathlib import Path

import pytest
import yaml

from drapeline import __version__
from drapeline.__main__ import main

ROOT = Path(__file__).parents[2]


def test_the_command_prints_the_version(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["drapeline", "--version"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    assert capsys.readouterr().out == f"drapeline {__version__}\n"


def test_the_citation_and_the_changelog_name_the_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    released = re.findall(
        r"^## \[(\d[^\]]*)\] - (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE
    )
    assert citation["version"] == __version__
    assert released[0] == (__version__, citation["date-released"])
