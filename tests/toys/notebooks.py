"""Run notebooks as programs, without Jupyter."""

import ast
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def run_notebook(path: Path, parameters: Mapping[str, Any]) -> tuple[dict[str, Any], list[Any]]:
    """Run the cells of a notebook one after another.

    Args:
        path: of the notebook.
        parameters: values that take the place of those in the notebook's first cell of code.

    Returns:
        Its variables, and what the cells that end in an expression would show.
    """
    cells = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]
    variables: dict[str, Any] = {}
    shown = []
    for number, cell in enumerate(cells):
        assert not any(output["output_type"] == "error" for output in cell["outputs"])
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"{path.name}, cell {number}", "exec"), variables)
        if number == 0:
            assert parameters.keys() <= variables.keys()
            variables |= parameters
        if last is not None:
            value = eval(compile(ast.Expression(last.value), path.name, "eval"), variables)
            shown += [value] if value is not None else []
    return variables, shown
