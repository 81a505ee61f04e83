from pathlib import Path

import pytest
import yaml

from drapeline.errors import InputError
from drapeline.experiment.config import fill_settings
from drapeline.experiment.settings import experiment_with
from drapeline.models.registry import models
from drapeline.settings import Field, Settings
from toys.imported_modules import loaded_modules

ROOT = Path(__file__).parents[3]
MODELS = {name: model.settings for name, model in models().items()}


def test_settings_load_nothing_that_takes_long():
    loaded = loaded_modules("import drapeline.experiment.settings")
    assert not loaded & {"torch", "bpy", "scipy", "warp", "trimesh", "pandas", "snakemake"}


def test_a_filled_config_makes_the_settings_that_its_classes_have():
    experiment = experiment_with(MODELS)
    filled = fill_settings({}, experiment.schema_of_config(), "")
    assert experiment(**filled) == experiment()
    tiny = yaml.safe_load((ROOT / "tests/data/tiny.yaml").read_text())
    filled = fill_settings(tiny, experiment.schema_of_config(), "tiny.yaml")
    assert experiment(**filled) == experiment(**tiny)


def test_a_model_of_somebody_else_has_its_block():
    class Theirs(Settings):
        """A model of somebody else."""

        width: int = Field(8, ge=1, description="Width.")

    experiment = experiment_with({**MODELS, "theirs": Theirs})
    schema = experiment.schema_of_config()
    assert schema["properties"]["theirs"]["description"] == "A model of somebody else."
    assert fill_settings({}, schema, "")["theirs"] == {"width": 8}
    with pytest.raises(InputError, match="Theirs: width is 0, expected an integer of at least 1"):
        experiment(theirs={"width": 0})
