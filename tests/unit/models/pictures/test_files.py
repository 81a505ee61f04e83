import json

import pytest

from drapeline.errors import InputError
from drapeline.models.pictures.files import files_of_picture, picture_files


def write(path, **entries):
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(entries))
    return path


def test_pictures_are_named_one_by_one_or_by_folder(tmp_path):
    one = write(tmp_path / "a/street.json")
    two = write(tmp_path / "b/yard.json")
    three = write(tmp_path / "b/beach.json")
    (tmp_path / "b/yard.png").touch()
    assert picture_files([one, tmp_path / "b"]) == [one, three, two]
    assert picture_files([]) == []


def test_pictures_of_one_name_are_refused(tmp_path):
    for folder in "ab":
        write(tmp_path / folder / "street.json")
    with pytest.raises(InputError, match="b/street.json: a picture of that name is also in .*/a,"):
        picture_files([tmp_path / "a", tmp_path / "b"])


def test_hidden_files_are_no_pictures(tmp_path):
    shown = write(tmp_path / "a/street.json")
    for name in ("._street.json", "..json", "...json"):
        write(tmp_path / "a" / name)
    assert picture_files([tmp_path / "a"]) == [shown]


@pytest.mark.parametrize("name", ["...json", "..json", "{x}.json", "a b.json", "-x.json"])
def test_names_that_may_not_become_paths_are_refused(tmp_path, name):
    path = write(tmp_path / "a" / name)
    with pytest.raises(InputError, match="the picture's name is .*, expected up to 100 letters"):
        picture_files([path])


def test_folders_without_pictures_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"contains no \.json"):
        picture_files([tmp_path])


def test_all_images_of_a_picture_are_listed(tmp_path):
    people = [{"mask": "first.png"}, {"gender": "male"}, "wrong"]
    path = write(
        tmp_path / "a/street.json",
        segmentation="labels.png",
        photo="../street.jpg",
        instances=None,
        people=people,
    )
    names = ("labels.png", "../street.jpg", "first.png")
    assert files_of_picture(path) == [path, *(path.parent / name for name in names)]


def test_a_file_that_is_no_picture_is_refused(tmp_path):
    (tmp_path / "street.json").write_text("[]")
    with pytest.raises(InputError, match="street.json: the file is .*, expected entries by name"):
        files_of_picture(tmp_path / "street.json")
