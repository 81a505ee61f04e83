"""The schema of configs, read once."""

from pathlib import Path

import yaml

_FILE = Path(__file__).parents[2] / "workflow/schemas/config.schema.yaml"
SCHEMA = yaml.load(_FILE.read_text(), yaml.CSafeLoader)  # the other one takes half a second
