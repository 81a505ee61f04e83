import pytest

from drapeline.__main__ import main


@pytest.fixture
def drapeline(monkeypatch, capsys):
    """drapeline(words, ...) -> what it prints, and its exit status or error."""

    def run(*words):
        monkeypatch.setattr("sys.argv", ["drapeline", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        return capsys.readouterr().out, ended.value.code

    return run
