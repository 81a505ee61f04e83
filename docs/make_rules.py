"""Write the list of all rules in docs/reference/rules.md from the scripts that they run.

.venv/bin/python docs/make_rules.py
"""

import ast
import re
from pathlib import Path

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
    "gcvae": "Garment VAEs",
    "gcvae_figures": "Figures and samples of the garment VAEs",
    "garment4d": "Garment4D",
    "garment4d_figures": "Figures of Garment4D",
    "garment4d_reconstruct": "Garments from your own scans",
    "smplicit": "SMPLicit",
    "smplicit_figures": "Figures of SMPLicit",
    "smplicit_gallery": "Gallery of SMPLicit",
    "smplicit_images": "SMPLicit on pictures",
    "smplicit_scans": "SMPLicit on scans",
    "evaluation": "Comparison of all models",
    "report": "Report",
}


def rules_of(file: str) -> dict[str, str]:
    """Rules of a file of the workflow that run a script -> what they do, in a sentence."""
    found: dict[str, str] = {}
    text = (ROOT / f"workflow/rules/{file}.smk").read_text()
    for block in re.split(r"^(?=rule \w+:$)", text, flags=re.MULTILINE):
        name = re.match(r"rule (\w+):", block)
        script = re.search(r'"\.\./\.\./(scripts/\w+\.py)"', block)
        if name and script:
            docstring = ast.get_docstring(ast.parse((ROOT / script[1]).read_text())) or ""
            about = " ".join(docstring.split("\n\n")[0].partition(": ")[2].split())
            found[name[1]] = about[:1].upper() + about[1:]
    return found


def rules_list() -> str:
    """The rules of all stages as Markdown."""
    parts = []
    for file, title in STAGES.items():
        rows = [f"| `{name}` | {about} |" for name, about in rules_of(file).items()]
        parts.append("\n".join([f"## {title}", "", "| rule | |", "|---|---|", *rows, ""]))
    return "\n".join(parts)


def rules_page(page: str) -> str:
    """A page with its list of rules written anew."""
    return BLOCK.sub(lambda match: f"{match[1]}\n{rules_list()}\n{match[2]}", page)


if __name__ == "__main__":
    PAGE.write_text(rules_page(PAGE.read_text()))
