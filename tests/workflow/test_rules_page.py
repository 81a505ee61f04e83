"""docs/reference/rules.md lists every rule, as docs/make_rules.py writes it."""

import re
import runpy

from toys.snakemake_run import ROOT

MAKE = runpy.run_path(str(ROOT / "docs/make_rules.py"))
PAGE = MAKE["PAGE"].read_text()
FILES = [ROOT / "Snakefile", *sorted((ROOT / "workflow/rules").glob("*.smk"))]


def test_the_page_is_in_step_with_the_scripts():
    assert MAKE["rules_page"](PAGE) == PAGE, "run `make docs`"


def test_every_rule_is_listed_or_named_as_a_target():
    listed = dict(re.findall(r"^\| `(\w+)` \| (?:.* \| )?(\S.*) \|$", PAGE, re.MULTILINE))
    only_targets = re.search(r"only name targets\n\((.*?)\)", PAGE, re.DOTALL)[1]
    texts = [file.read_text() for file in FILES]
    rules = {name for text in texts for name in re.findall(r"^ *rule (\w+):", text, re.M)}
    use = r"^ *use rule \w+ as (\w+)"
    rules |= {name for text in texts for name in re.findall(use, text, re.M)}
    assert rules <= {*listed, *re.findall(r"\w+", only_targets)}
