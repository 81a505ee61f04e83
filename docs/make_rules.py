"""Write the list of all rules in docs/reference/rules.md: what scripts and models say of them.

PYTHONPATH=src .venv/bin/python docs/make_rules.py
"""

import ast
import re
from collections import defaultdict
from pathlib import Path

import yaml

from drapeline.experiment.config import fill_settings
from drapeline.experiment.files import ExperimentFiles
from drapeline.experiment.groups import plan_groups
from drapeline.frames import GENDERS
from drapeline.models.registry import Model, models
from drapeline.motions.table import FrameCounts, MotionTable

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/reference/rules.md"
BLOCK = re.compile(r"(<!-- rules -->\n).*?(<!-- end of rules -->)", re.DOTALL)
# File of the workflow -> what its rules do.
STAGES = {
    "bodies": "Bodies and motions",
    "outfits": "Outfits",
    "simulation": "Simulation",
    "dataset": "Dataset and exports",
    "renders": "Pictures",
    "registration": "Registration to the body",
    "learning_data": "Data for learning",
    "scans": "Segmented scans",
    "pictures": "Your own pictures",
    "gcvae_pictures": "Garment VAE on your own pictures",
    "garment4d": "Shards for Garment4D",
    "garment4d_reconstruct": "Garment4D on your own scans",
    "smplicit": "Shards for SMPLicit",
    "smplicit_images": "SMPLicit on your own pictures",
    "smplicit_scans": "SMPLicit on your own scans",
    "evaluation": "Comparison of all models",
    "release": "To be passed on",
    "report": "Report",
}


def rules_of(file: str) -> dict[str, str]:
    """Rules of a file of the workflow that run a script -> what they do, in a sentence."""
    found: dict[str, str] = {}
    text = (ROOT / f"workflow/rules/{file}.smk").read_text()
    # Some rules are there in some experiments alone, and indented.
    for block in re.split(r"^ *(?=rule \w+:$)", text, flags=re.MULTILINE):
        name = re.match(r"rule (\w+):", block)
        script = re.search(r'"\.\./\.\./(scripts/\w+\.py)"', block)
        if name and script:
            docstring = ast.get_docstring(ast.parse((ROOT / script[1]).read_text())) or ""
            about = " ".join(docstring.split("\n\n")[0].partition(": ")[2].split())
            found[name[1]] = about[:1].upper() + about[1:]
    for used, name in re.findall(r"^ *use rule (\w+) as (\w+)", text, re.MULTILINE):
        found[name] = found[used]
    return found


def tasks_of(model: Model) -> list[str]:
    """What the default experiment can do with a model, as rows of a table."""
    settings = fill_settings(
        yaml.safe_load((ROOT / "config.yaml").read_text()),
        yaml.safe_load((ROOT / "workflow/schemas/config.schema.yaml").read_text()),
        "config.yaml",
    )
    clips = MotionTable(ROOT / "workflow/resources/motions/clips.tsv")
    groups = plan_groups(settings, clips, FrameCounts())
    bodies = {gender: f"resources/body/{gender}.npz" for gender in GENDERS}
    plan = model.plan(ExperimentFiles(settings, groups, bodies, hanging_solver=""))
    evaluations = {name: evaluation.task for name, evaluation in plan.evaluations.items()}
    kinds = {
        "collect_data": plan.data,
        "train": plan.trainings,
        "evaluate": evaluations,
        "sample_model": plan.samples,
    }
    rows = []
    for rule, tasks in kinds.items():
        folders = defaultdict(list)
        for folder, task in tasks.items():
            folders[task.run].append(f"`{model.name}/{folder}`")
        for run, names in folders.items():
            more = f" and {len(names) - 1} more" if names[1:] else ""
            rows.append(f"| `{rule}` | {names[0]}{more} | {_about(run)} |")
    for rule, figure in plan.figures.items():
        files = [f"`report/{getattr(one, 'file', one)}`" for one in figure.output.values()]
        more = f" and {len(files) - 1} more" if files[1:] else ""
        rows.append(f"| `{rule}` | {files[0]}{more} | {_about(figure.task.run)} |")
    return rows


def _about(run: str) -> str:
    """The first sentence of the docstring of `package.module:function`."""
    module, _, name = run.partition(":")
    tree = ast.parse((ROOT / "src" / f"{module.replace('.', '/')}.py").read_text())
    functions = (node for node in tree.body if isinstance(node, ast.FunctionDef))
    (found,) = (function for function in functions if function.name == name)
    return _sentence((ast.get_docstring(found) or "").partition("\n\n")[0])


def _sentence(text: str) -> str:
    text = " ".join(text.split()).removesuffix(".")
    return text[:1].upper() + text[1:]


def rules_list() -> str:
    """The rules of all stages, and the tasks of all models, as Markdown."""
    parts = []
    for file, title in STAGES.items():
        rows = [f"| `{name}` | {about} |" for name, about in rules_of(file).items()]
        parts.append("\n".join([f"## {title}", "", "| rule | |", "|---|---|", *rows, ""]))
    for model in models().values():
        head = [f"## {model.title}", "", "| rule | in the results | |", "|---|---|---|"]
        parts.append("\n".join([*head, *tasks_of(model), ""]))
    return "\n".join(parts)


def rules_page(page: str) -> str:
    """A page with its list of rules written anew."""
    return BLOCK.sub(lambda match: f"{match[1]}\n{rules_list()}\n{match[2]}", page)


if __name__ == "__main__":
    PAGE.write_text(rules_page(PAGE.read_text()))
