from drapeline.models.pictures.files import files_of_picture, picture_files

try:
    # The user's own, by name.
    PICTURES = {
        file.stem: str(file) for file in picture_files(config["smplicit"]["images"])
    }
except InputError as error:
    raise WorkflowError(str(error)) from None


wildcard_constraints:
    picture="|".join(map(re.escape, PICTURES)) or "no picture",


def own_picture(wildcards):
    """Input function: a picture's JSON, first of all, and the images that it names."""
    try:
        files = [*map(str, files_of_picture(PICTURES[wildcards.picture]))]
    except InputError as error:
        raise WorkflowError(str(error)) from None
    return {"picture": files[0], "images": files[1:]}


def pictures_by(model):
    """Input function: what a model makes of all of the user's pictures."""

    def made(wildcards):
        if not PICTURES:
            raise WorkflowError(
                "smplicit.images is empty, expected a .json for each of your pictures, or folders"
                " of them"
            )
        images = f"{RESULTS}/{model}/images"
        return expand(
            [f"{images}/{{picture}}", f"{images}/{{picture}}.png"], picture=PICTURES
        )

    return made
