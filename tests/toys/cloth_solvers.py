"""The table of cloth solvers in workflow/rules/groups_common.smk."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def cloth_solvers(root: Path = ROOT) -> dict[str, tuple[str, str]]:
    """Name -> module that has `cloth_solver`, and path of the environment from the rules."""
    text = (root / "workflow/rules/groups_common.smk").read_text()
    table = re.search(r"^CLOTH_SOLVERS = (\{.*?^\})", text, re.M | re.S).group(1)

    return {
        key.value: (row.args[0].value, row.args[1].value)
        for key, row in _items(ast.parse(table, mode="eval").body)
    }


def _items(table: ast.Dict) -> list[tuple[ast.Constant, ast.Call]]:
    return list(zip(table.keys, table.values, strict=True))
