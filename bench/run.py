"""Measure drapeline beside its peers and write the table of docs/background/speed.md.

make bench RESULTS=results

RESULTS is the folder of results of an experiment that is finished. It takes ten minutes.
"""

import os
import re
import sys
from datetime import date
from pathlib import Path

import gcvae_step
import health
import imports
import open_sample
import point_search
import skinning
import smplicit_field
import torch
from side_by_side import HEADINGS

PAGE = Path(__file__).parents[1] / "docs/background/speed.md"
BLOCK = re.compile(r"(<!-- measured -->\n).*?(<!-- end of measured -->)", re.DOTALL)
PARTS = (gcvae_step, point_search, skinning, open_sample, smplicit_field)


def processor() -> str:
    """Its name, as the system has it."""
    found = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    return found[1] if found else "an unknown processor"


def main(results: Path) -> None:
    """Print every row as soon as it is known, and write all of them to the page."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    torch.set_num_threads(1)
    lines = ["| " + " | ".join(HEADINGS) + " |", "|---" * len(HEADINGS) + "|"]
    for part in PARTS:
        for row in part.rows(results):
            lines.append("| " + " | ".join(row.cells()) + " |")
            print(lines[-1], flush=True)
    about = (
        f"Measured {date.today():%B %Y} on one core of {processor()}, PyTorch {torch.__version__}."
    )
    text = "\n\n".join(
        [about, "\n".join(lines), health.sentence(results), imports.sentence(results)]
    )
    PAGE.write_text(BLOCK.sub(lambda m: f"{m[1]}{text}\n{m[2]}", PAGE.read_text()))


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
