"""Lightning is imported without packages that no training uses."""

import os
import subprocess
import sys

STARTED = """
import sys
from drapeline.models.training import lightning_parts
assert lightning_parts.Trainer is sys.modules["pytorch_lightning"].Trainer
assert not {"scipy.signal", "matplotlib"} & sys.modules.keys()

# Afterwards both are there again for whoever asks, and the metrics compute.
from lightning_utilities.core.imports import RequirementCache, package_available
assert package_available("scipy") and RequirementCache("matplotlib")
assert not package_available("no_such_package") and not RequirementCache("no_such_package")
from torchmetrics import MeanMetric
mean = MeanMetric()
mean.update([1.0, 3.0])
assert mean.compute() == 2
"""


def test_scipy_signal_and_matplotlib_stay_out_and_are_found_later():
    path = os.pathsep.join(sys.path)
    subprocess.run(
        [sys.executable, "-c", STARTED], check=True, env=os.environ | {"PYTHONPATH": path}
    )
