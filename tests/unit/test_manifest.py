import hashlib

import pytest

from drapeline.errors import DamagedFile
from drapeline.manifest import FileSum, damages, read_manifest, write_manifest


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "a.bin").write_bytes(bytes(range(256)) * 5000)  # more than a chunk
    (tmp_path / "odd name.txt").write_text("")
    (tmp_path / ".hidden").touch()
    (tmp_path / ".writing-x").mkdir()
    (tmp_path / ".writing-x" / "part").touch()
    write_manifest(tmp_path)
    return tmp_path


def test_sizes_and_sums_are_those_of_the_files(folder):
    data = (folder / "deep" / "a.bin").read_bytes()
    assert read_manifest(folder / "manifest.tsv") == {
        "deep/a.bin": FileSum(len(data), hashlib.sha256(data).hexdigest()),
        "odd name.txt": FileSum(0, hashlib.sha256(b"").hexdigest()),
    }
    assert not list(damages(folder, sums=True))


def test_a_manifest_does_not_list_itself_or_read_what_is_known(folder):
    known = {"deep/a.bin": FileSum(3, "ab" * 32)}
    write_manifest(folder, "deep/manifest.tsv", known=known)
    listed = read_manifest(folder / "deep" / "manifest.tsv")
    assert listed["deep/a.bin"] == known["deep/a.bin"]
    assert set(listed) == {"deep/a.bin", "odd name.txt", "manifest.tsv"}


def test_another_size_and_a_missing_file_are_noticed_without_reading(folder):
    file = folder / "deep" / "a.bin"
    file.write_bytes(file.read_bytes()[:-1])
    (folder / "odd name.txt").unlink()
    (folder / "of mine").touch()  # files may be added
    found = list(damages(folder, sums=False))
    assert [damage.path for damage in found] == [file, folder / "odd name.txt"]
    assert "a.bin: 1279999 bytes, expected 1280000 as in" in str(found[0])
    assert "cannot be read (No such file or directory), but" in str(found[1])


def test_another_byte_is_noticed_where_sums_are_asked_for(folder):
    file = folder / "deep" / "a.bin"
    data = bytearray(file.read_bytes())
    data[-1] ^= 1
    file.write_bytes(data)
    assert not list(damages(folder, sums=False))
    (damage,) = damages(folder, sums=True)
    assert str(damage) == f"{file}: its SHA-256 sum is not the one in {folder / 'manifest.tsv'}"


SUM = "0" * 64
HEADING = "file\tbytes\tsha256"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "begins with '', expected 'file"),
        ("file\tbytes\n", "begins with 'file"),
        (f"{HEADING}\n../a\t1\t{SUM}\n", r"line 2 is '\.\./a.*', expected a file in its folder"),
        (f"{HEADING}\na\t1\t{SUM}\na/./b\t1\t{SUM}\n", "line 3 is 'a/./b"),
        (f"{HEADING}\n/etc/passwd\t1\t{SUM}\n", "line 2 is '/etc/passwd"),
        (f"{HEADING}\n\t1\t{SUM}\n", "line 2 is '"),
        (f"{HEADING}\na\t-1\t{SUM}\n", "line 2 is 'a"),
        (f"{HEADING}\na\t\u00b2\t{SUM}\n", "line 2 is 'a"),
        (f"{HEADING}\na\t1\tabc\n", "line 2 is 'a"),
        (f"{HEADING}\na\t1\n", "line 2 is 'a"),
        (None, "no such file, expected a manifest"),
    ],
)
def test_unusable_manifests_are_named(tmp_path, text, message):
    path = tmp_path / "manifest.tsv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(DamagedFile, match=rf"manifest\.tsv: {message}"):
        read_manifest(path)
