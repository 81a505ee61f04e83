import pytest

from drapeline.source_digest import imported_files, source_digest


@pytest.fixture
def tree(tmp_path):
    """script -> a -> b.c (with data beside it); d is not used."""
    package = tmp_path / "src" / "drapeline"
    (package / "b").mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "a.py").write_text("from drapeline.b import c\n\ndef f():\n    return c.g()\n")
    (package / "b" / "__init__.py").touch()
    (package / "b" / "c.py").write_text('"""Doc."""\n\ndef g():\n    return 1\n')
    (package / "b" / "names.yaml").write_text("x: 1\n")
    (package / "d.py").write_text("y = 1\n")
    script = tmp_path / "script.py"
    script.write_text("from drapeline.a import f\n\nf()\n")
    return script, tmp_path / "src", package


def test_imports_are_followed_however_deep(tree):
    script, source, package = tree
    found = imported_files(script, source)
    assert found == {package / "a.py", package / "b" / "c.py", package / "b" / "names.yaml"}


@pytest.mark.parametrize(
    ("name", "text", "changes"),
    [
        ("b/c.py", "def g():\n    return 2\n", True),
        ("b/names.yaml", "x: 2\n", True),
        ("b/c.py", '"""Other words."""\n\n# why\ndef g():\n\n    return 1\n', False),
        ("d.py", "y = 2\n", False),
    ],
)
def test_the_digest_changes_with_used_code_only(tree, name, text, changes):
    script, source, package = tree
    before = source_digest(script, source)
    (package / name).write_text(text)
    assert (source_digest(script, source) != before) == changes


def test_a_change_of_the_script_counts(tree):
    script, source, _ = tree
    before = source_digest(script, source)
    script.write_text(script.read_text() + "f()\n")
    assert source_digest(script, source) != before


def test_a_module_that_is_not_there_is_an_error(tree):
    script, source, _ = tree
    script.write_text("import drapeline.nothing\n")
    with pytest.raises(FileNotFoundError, match="drapeline.nothing"):
        source_digest(script, source)
