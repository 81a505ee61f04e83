"""The table of cloth solvers in workflow/rules/simulation.smk."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def cloth_solvers(root: Path = ROOT) -> dict[str, tuple[str, str]]:
    """Name -> module that has `cloth_solver`, and path of the environment from the rules."""
    text = (root / "workflow/rules/simulation.smk").read_text()
    return ast.literal_eval(re.search(r"^CLOTH_SOLVERS = (\{.*?^\})", text, re.M | re.S).group(1))
