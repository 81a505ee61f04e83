"""What the documentation names exists: modules, functions, rules, settings, files, links, commands.

Its pages are of four kinds, kept apart by folder, and all can be reached from docs/README.md.
"""

import ast
import json
import re
import shlex
from functools import cache
from pathlib import Path

import pytest
import yaml

import drapeline
from drapeline.experiment.config import fill_settings
from drapeline.generation import moving_outfits
from drapeline.models.registry import models
from toys.bounds import NO_BOUNDS
from toys.plans import files_of
from toys.schema import SCHEMA

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src"
PAGES = [
    ROOT / "README.md",
    *(ROOT / name / "README.md" for name in ("config", "examples", "workflow/resources/motions")),
    *(ROOT / f"{name}.md" for name in ("CHANGELOG", "CONTRIBUTING")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
SMK = [ROOT / "Snakefile", *sorted((ROOT / "workflow/rules").glob("*.smk"))]
RULES = {
    name
    for path in SMK
    for name in re.findall(r"^(?:use rule \w+ as|rule) (\w+)", path.read_text(), re.MULTILINE)
}
for plan in (model.plan(files_of()) for model in models().values()):
    RULES |= {*plan.figures, *plan.targets}
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@cache
def definitions(module: str) -> dict[str, ast.AST] | None:
    """Top-level names of a module of the library, or None if there is no such module."""
    path = SOURCE / module.replace(".", "/")
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    if not file.is_file():
        return None
    tree = ast.parse(file.read_text())
    found = dict.fromkeys(drapeline.__all__, tree) if module == "drapeline" else {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node.name] = node
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {t.id: node for t in targets if isinstance(t, ast.Name)}
    return found


def exists(name: str) -> bool:
    """Whether `drapeline.room.module`, or a function or class in it, is there."""
    if definitions(name) is not None:
        return True
    module, _, attribute = name.rpartition(".")
    return attribute in (definitions(module) or {})


def text_of(page: Path) -> str:
    return FENCED.sub("", page.read_text())


def marked(page: Path) -> list[str]:
    """What stands between backticks."""
    return re.findall(r"`([^`\n]+)`", text_of(page))


def anchor(heading: str) -> str:
    return re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")


pages = pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))


@pages
def test_modules_and_functions_exist(page):
    for code in marked(page):
        for name in set(re.findall(r"\bdrapeline(?:\.\w+)+", code)) - {"drapeline.def"}:
            assert exists(name), f"{page.name} names {name}"


@pages
def test_imports_in_examples_exist(page):
    for language, block in FENCED.findall(page.read_text()):
        if language != "python":
            continue
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("drapeline"):
                for alias in node.names:
                    name = f"{node.module}.{alias.name}"
                    assert exists(name), f"{page.name} imports {name}"


SHORT = {"drapeline", "drapeline.torch"}
OF_USERS = [page for page in PAGES if page.name not in {"extending.md", "CHANGELOG.md"}]
NOTEBOOK = json.loads((ROOT / "examples/tour.ipynb").read_text())


@pytest.mark.parametrize(
    "code",
    [
        *(
            "".join(block for lang, block in FENCED.findall(p.read_text()) if lang == "python")
            for p in OF_USERS
        ),
        "\n".join("".join(c["source"]) for c in NOTEBOOK["cells"] if c["cell_type"] == "code"),
    ],
    ids=[*(str(page.relative_to(ROOT)) for page in OF_USERS), "tour.ipynb"],
)
def test_code_for_users_takes_public_names_alone(code):
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("drapeline"):
            assert node.module in SHORT
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "drapeline":
            assert node.attr in drapeline.__all__
        elif isinstance(node, ast.Import):
            named = {alias.name for alias in node.names}
            assert {name for name in named if name.startswith("drapeline")} <= SHORT


def sections(page: Path, *headings: str) -> str:
    """Python of sections of a page, one after another."""
    parts = re.split(r"^## (.*)$", page.read_text(), flags=re.MULTILINE)
    texts = dict(zip(parts[1::2], parts[2::2], strict=True))
    blocks = (FENCED.findall(texts[heading]) for heading in headings)
    return "".join(block for found in blocks for language, block in found if language == "python")


@pytest.mark.portable
def test_motions_simulations_and_measures_of_the_library_run_as_they_stand(monkeypatch):
    monkeypatch.chdir(ROOT)
    # How healthy the cloth is, another processor may decide otherwise.
    monkeypatch.setattr(moving_outfits, "HealthBounds", lambda **_: NO_BOUNDS)
    code = sections(ROOT / "docs/reference/api.md", "Motions", "Simulations", "Measures")
    saved = []
    for name in ("save_motion", "save_outfit"):
        monkeypatch.setattr(drapeline, name, lambda *given: saved.append(given))
    names = {}
    exec(compile(code, "api.md", "exec"), names)
    assert [path for path, _ in saved] == ["jump.npz", "jump.glb"]
    assert saved[1][1] is names["worn"]
    assert set(names["worn"].garments) == {"Tshirt", "Skirt"}
    assert len(names["shirt"].frames) == len(names["worn"].body) == 6
    assert names["picture"].shape == (290, 250, 3)
    assert names["errors"]["vertex_error_mm"] == 0


@pages
def test_rules_exist(page):
    text = text_of(page)
    for name in re.findall(r"\brules? `(\w+)`", text):
        assert name in RULES, f"{page.name} names the rule {name}"


def test_the_steps_from_clip_to_model_name_rules():
    text = text_of(ROOT / "docs/background/architecture.md")
    rows = re.findall(r"^\| [\w ]+ \| ((?:`[\w*]+`,? ?)+)", text, re.MULTILINE)
    names = [name for row in rows for name in re.findall(r"`([\w*]+)`", row)]
    assert len(names) > 10
    for name in names:
        pattern = re.compile(name.replace("*", r"\w+"))
        assert any(pattern.fullmatch(rule) for rule in RULES), f"architecture.md names {name}"


def links(page: Path) -> list[str]:
    """Targets of a page's links and pictures within the repository."""
    found = re.findall(r"\]\(([^)\s]+)\)", text_of(page))
    return [target for target in found if not target.startswith("http")]


@pages
def test_links_lead_somewhere(page):
    for target in links(page):
        file, _, heading = target.partition("#")
        path = (page.parent / file) if file else page
        assert path.exists(), f"{page.name} links to {target}"
        if heading:
            headings = re.findall(r"^#+ (.*)$", path.read_text(), re.MULTILINE)
            assert heading in map(anchor, headings), f"{page.name} links to {target}"


def setting(name: str) -> bool:
    """Whether a dotted name is a key of the config, or one within `garment4d`."""
    for part in (SCHEMA, SCHEMA["properties"]["garment4d"]):
        for key in name.split("."):
            part = part.get("properties", {}).get(key)
            if part is None:
                break
        else:
            return True
    return False


@pages
def test_settings_exist(page):
    sections = {*SCHEMA["properties"], *SCHEMA["properties"]["garment4d"]["properties"]}
    for code in marked(page):
        name = code.partition(":")[0]
        first, dot, _ = name.partition(".")
        is_file = re.search(r"\.(npz|npy|tsv|json|obj|py|html|png|svg|ckpt)$", name)
        if dot and first in sections and re.fullmatch(r"[\w.]+", name) and not is_file:
            assert setting(name), f"{page.name} names the setting {name}"


@pages
def test_settings_in_examples_exist(page):
    for language, block in FENCED.findall(page.read_text()):
        if language != "yaml":
            continue
        given = yaml.safe_load(block)
        if set(given) <= set(SCHEMA["properties"]):  # else another file, such as a joint map
            fill_settings(given, SCHEMA, page.name)


def test_pages_are_of_four_kinds():
    docs = ROOT / "docs"
    assert {path.name for path in docs.glob("*.md")} == {"README.md", "tutorial.md"}
    kinds = {path.parent.name for path in docs.glob("*/*.md")}
    assert kinds == {"how-to", "reference", "background"}
    assert not list(docs.glob("*/*/*.md"))


def test_the_index_links_to_every_page():
    index = ROOT / "docs/README.md"
    linked = {(index.parent / target.partition("#")[0]).resolve() for target in links(index)}
    pages = {path.resolve() for path in (ROOT / "docs").rglob("*.md")} - {index}
    assert linked == {*pages, ROOT / "CONTRIBUTING.md"}


def test_the_readme_leads_to_the_index_the_tutorial_and_contributors():
    expected = {"docs/README.md", "docs/tutorial.md", "CONTRIBUTING.md"}
    assert expected <= set(links(ROOT / "README.md"))


def commands(page: Path) -> list[list[str]]:
    """Words of every command in a page's shell blocks, without comments."""
    blocks = [block for language, block in FENCED.findall(page.read_text()) if language == "bash"]
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [words for line in lines if (words := shlex.split(line, comments=True))]


@pages
def test_commands_name_targets_files_and_programs_that_exist(page):
    goals = set(re.findall(r"^(\w[\w-]*):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for words in commands(page):
        program, *rest = words
        if program.startswith(".venv/bin/"):
            assert program.removeprefix(".venv/bin/") in {
                *("drapeline", "python", "snakemake", "tensorboard")
            }
        assert program != "snakemake", f"{page.name}: it is .venv/bin/snakemake"
        if program == "make":
            named = [word for word in rest if "=" not in word]
            assert set(named) <= goals, f"{page.name}: make {named}"
        for word in rest:
            if word.startswith(("workflow/", "tests/", "examples/")):
                assert (ROOT / word).exists(), f"{page.name} names {word}"
        if program.endswith("snakemake"):
            targets = rest[: next((i for i, w in enumerate(rest) if w.startswith("-")), None)]
            for target in targets:
                made = target.startswith(("results/", "resources/"))
                assert made or target in RULES, f"{page.name} asks for {target}"
            # `--configfile` takes all names that follow.
            after = rest[rest.index("--configfile") + 1 :] if "--configfile" in rest else []
            assert all(word.endswith(".yaml") for word in after), f"{page.name}: {after}"
