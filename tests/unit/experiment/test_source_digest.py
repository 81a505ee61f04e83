import pytest

from drapeline.experiment import source_digest
from drapeline.experiment.source_digest import Sources


@pytest.fixture
def tree(tmp_path):
    """script -> a -> b.c -> b/names.yaml and b/maps/*.yaml; b/other.yaml and d are not used."""
    package = tmp_path / "src" / "drapeline"
    (package / "b").mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "a.py").write_text("from drapeline.b import c\n\ndef f():\n    return c.g()\n")
    (package / "b" / "__init__.py").touch()
    (package / "b" / "c.py").write_text(
        '"""Reads other.yaml."""\n\ndef g():\n    return "names.yaml", "maps"\n'
    )
    (package / "b" / "maps").mkdir()
    for name in ("names", "other", "maps/one", "maps/two"):
        (package / "b" / f"{name}.yaml").write_text("x: 1\n")
    (package / "d.py").write_text("y = 1\n")
    script = tmp_path / "script.py"
    script.write_text("from drapeline.a import f\n\nf()\n")
    return script, tmp_path / "src", package


def test_imports_are_followed_however_deep(tree):
    script, source, package = tree
    found = Sources(source).imported_files(script)
    assert {str(path.relative_to(package)) for path in found} == {
        *("a.py", "b/c.py"),
        *("b/names.yaml", "b/maps/one.yaml", "b/maps/two.yaml"),
    }


def test_a_data_file_counts_only_for_modules_above_it_that_name_it(tree):
    script, source, package = tree
    (package / "b" / "c.py").write_text("def g():\n    return 1\n")
    (package / "a.py").write_text('from drapeline.b import c\n\nNAMED = "maps", "d.yaml"\n')
    (package / "d.yaml").write_text("x: 1\n")
    found = Sources(source).imported_files(script)
    # A folder's name means the folder wherever it stands below the module.
    data = {package / "d.yaml", *(package / "b" / "maps").iterdir()}
    assert {path for path in found if path.suffix == ".yaml"} == data


@pytest.mark.parametrize(
    ("name", "text", "changes"),
    [
        ("b/c.py", "def g():\n    return 2\n", True),
        ("b/names.yaml", "x: 2\n", True),
        ("b/maps/two.yaml", "x: 2\n", True),
        ("b/other.yaml", "x: 2\n", False),
        (
            "b/c.py",
            '"""Other words."""\n\n# why\ndef g():\n\n    return ("names.yaml",\'maps\')\n',
            False,
        ),
        ("d.py", "y = 2\n", False),
    ],
)
def test_the_digest_changes_with_used_code_only(tree, name, text, changes):
    script, source, package = tree
    before = Sources(source).digest(script)
    (package / name).write_text(text)
    assert (Sources(source).digest(script) != before) == changes


def test_imports_for_type_checkers_alone_do_not_count(tree):
    script, source, package = tree
    (package / "b" / "c.py").write_text(
        "from typing import TYPE_CHECKING\n\nif TYPE_CHECKING:\n    from drapeline.d import y\n"
        "else:\n    import drapeline.b.e\n"
    )
    (package / "b" / "e.py").touch()
    found = {path.name for path in Sources(source).imported_files(script)}
    assert found == {"a.py", "c.py", "e.py"}


def test_a_change_of_the_script_counts(tree):
    script, source, _ = tree
    before = Sources(source).digest(script)
    script.write_text(script.read_text() + "f()\n")
    assert Sources(source).digest(script) != before


def test_modules_that_a_script_is_told_of_count_with_what_they_import(tree):
    script, source, package = tree
    (package / "d.py").write_text("from drapeline import e\n")
    (package / "e.py").write_text("z = 1\n")
    found = Sources(source).imported_files(script, "drapeline.d")
    assert found - Sources(source).imported_files(script) == {package / "d.py", package / "e.py"}
    before = Sources(source).digest(script, "drapeline.d")
    (package / "e.py").write_text("z = 2\n")
    assert Sources(source).digest(script, "drapeline.d") != before
    with pytest.raises(FileNotFoundError, match="drapeline.f"):
        Sources(source).digest(script, "drapeline.f")


def test_a_module_that_is_not_there_is_an_error(tree):
    script, source, _ = tree
    script.write_text("import drapeline.nothing\n")
    with pytest.raises(FileNotFoundError, match="drapeline.nothing"):
        Sources(source).digest(script)


def test_parsed_files_are_kept_and_changes_are_still_seen(tree, tmp_path, monkeypatch):
    script, source, package = tree
    memory = tmp_path / "kept" / "sources.json"
    first = Sources(source, memory)
    before = first.digest(script)
    first.remember()
    with monkeypatch.context() as patch:
        patch.setattr(source_digest, "_parse", None)  # nothing is parsed again
        assert Sources(source, memory).digest(script) == before
    (package / "a.py").write_text("from drapeline.b import c\n\ndef f():\n    return 0\n")
    assert Sources(source, memory).digest(script) == Sources(source).digest(script) != before


@pytest.mark.parametrize("text", ["{", "[]", '{"x": 1}', '{"x": ["y", [1]]}'])
def test_a_damaged_memory_does_no_harm(tree, tmp_path, text):
    script, source, _ = tree
    memory = tmp_path / "sources.json"
    memory.write_text(text)
    assert Sources(source, memory).digest(script) == Sources(source).digest(script)


def test_a_memory_with_an_import_changed_does_no_harm(tree, tmp_path):
    script, source, _ = tree
    memory = tmp_path / "sources.json"
    kept = Sources(source, memory)
    before = kept.digest(script)
    kept.remember()
    text = memory.read_text()
    assert "drapeline.a" in text
    memory.write_text(text.replace("drapeline.a", "drapeline.z"))
    assert Sources(source, memory).digest(script) == before
