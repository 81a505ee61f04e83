"""The digest of a script changes with the code that it reaches, and with nothing else."""

import pytest

from drapeline.experiment import source_digest
from drapeline.experiment.source_digest import Sources

# Scripts `one` and `two` share a file; each calls a function of its own there.
SHARED = '''"""Both."""

import math

from drapeline.tools import Box, helper

LIMIT = 3


def first(x):
    """What one calls."""
    return helper(x) + LIMIT


def second(x):
    return Box(math.sqrt(x)).doubled()
'''
TOOLS = '''"""Tools."""

from typing import NamedTuple


def helper(x: int) -> int:
    return x + 1


class Box(NamedTuple):
    """A number."""

    x: float

    def doubled(self):
        return 2 * self.x

    def tripled(self):
        return 3 * self.x
'''


@pytest.fixture
def package(tmp_path):
    """write(**files): files of the package, "b.py" as b=...; two scripts lie beside it."""
    folder = tmp_path / "src" / "drapeline"
    (folder / "rooms").mkdir(parents=True)
    for name in ("__init__.py", "rooms/__init__.py"):
        (folder / name).touch()
    (folder / "shared.py").write_text(SHARED)
    (folder / "tools.py").write_text(TOOLS)
    for script, function in (("one", "first"), ("two", "second")):
        text = f"from drapeline.shared import {function}\n\n{function}(1)\n"
        (tmp_path / f"{script}.py").write_text(text)
    return folder


def digests(package, *named):
    """Digest of each script."""
    source = package.parent
    scripts = sorted(source.parent.glob("*.py"))
    sources = Sources(source)
    return {script.stem: sources.digest(script, *named) for script in scripts}


def changed(package, edit, *named):
    """The scripts whose digests an edit changes."""
    before = digests(package, *named)
    edit()
    after = digests(package, *named)
    return {script for script in before if before[script] != after[script]}


def replaced(path, text, put):
    """replaced(...)() puts another text into a file, in which the old one must be."""

    def edit():
        assert text in path.read_text()
        path.write_text(path.read_text().replace(text, put))

    return edit


@pytest.mark.parametrize(
    ("file", "text", "put", "scripts"),
    [
        ("shared.py", "+ LIMIT", "- LIMIT", {"one"}),
        ("shared.py", "LIMIT = 3", "LIMIT = 4", {"one"}),
        ("shared.py", "sqrt", "cbrt", {"two"}),
        ("shared.py", "import math", "import cmath as math", {"two"}),
        ("tools.py", "x + 1", "x + 2", {"one"}),
        ("tools.py", "2 * self.x", "4 * self.x", {"two"}),
        ("tools.py", "x: float", "x: int", {"two"}),
        ("tools.py", "Box(NamedTuple)", "Box(tuple)", {"two"}),
        # Nobody calls this method, and nothing reads this annotation.
        ("tools.py", "3 * self.x", "5 * self.x", set()),
        ("tools.py", "x: int", "x: float", set()),
        ("tools.py", "a number", "some number", set()),
        ("tools.py", "def helper", "# why\n\ndef helper", set()),
        ("shared.py", "What one calls", "Something else", set()),
        ("tools.py", '"""Tools."""', '"""Tools."""\n\nUNUSED = 1', set()),
    ],
)
def test_a_change_reaches_the_scripts_that_run_it(package, file, text, put, scripts):
    TOOLS_TEXT = (package / "tools.py").read_text()
    (package / "tools.py").write_text(TOOLS_TEXT.replace("A number", "a number"))
    assert changed(package, replaced(package / file, text, put)) == scripts


def test_a_change_of_a_script_counts(package):
    script = package.parents[1] / "one.py"
    assert changed(package, replaced(script, "first(1)", "first(2)")) == {"one"}


def test_code_that_moves_to_another_file_counts_as_it_was(package):
    def move():
        text = (package / "tools.py").read_text()
        cut = text.index("class Box")
        (package / "rooms" / "box.py").write_text(
            "from typing import NamedTuple\n\n\n" + text[cut:]
        )
        (package / "tools.py").write_text(text[:cut])
        replaced(
            package / "shared.py",
            "from drapeline.tools import Box, helper",
            "from drapeline.rooms.box import Box\nfrom drapeline.tools import helper",
        )()

    assert changed(package, move) == set()


def test_what_a_name_means_counts_even_if_all_code_is_reached_anyway(package):
    """Two helpers of one name change places."""
    for name, body in (("left", "return 1"), ("right", "return 2")):
        (package / f"{name}.py").write_text(f"def helper():\n    {body}\n")
    script = package.parents[1] / "one.py"
    text = "from drapeline.left import helper as a\nfrom drapeline.right import helper as b\n\n"
    script.write_text(text + "a() - b()\n")

    def swap():
        for old, new in (("helper as a", "helper as c"), ("as b", "as a"), ("as c", "as b")):
            replaced(script, old, new)()

    assert changed(package, swap) == {"one"}


@pytest.mark.parametrize(
    "use",
    [
        "from drapeline import hidden\n\nprint(vars(hidden))",
        "import drapeline.hidden as hidden\n\nprint(getattr(hidden, name))",
        "from drapeline.hidden import *\n\nprint(found)",
        "from drapeline.hidden import missing\n\nprint(missing)",
        "from importlib import import_module\n\nprint(import_module('drapeline.hidden'))",
        "from drapeline.hidden import by_name\n\nprint(by_name('found'))",
    ],
)
def test_where_names_cannot_be_followed_all_of_a_file_counts(package, use):
    hidden = package / "hidden.py"
    hidden.write_text("def by_name(x):\n    return globals()[x]\n\n\ndef found():\n    return 1\n")
    for script in ("one", "three"):
        path = package.parents[1] / f"{script}.py"
        path.write_text(use + "\n")
    assert changed(package, replaced(hidden, "return 1", "return 2")) == {"one", "three"}


@pytest.mark.parametrize(
    "use",
    [
        "import drapeline.tools\n\ndrapeline.tools.helper(1)",
        "import drapeline.tools as t\n\nt.helper(1)",
        "from drapeline import tools\n\ntools.helper(1)",
        "def inner():\n    from drapeline.tools import helper\n\n    return helper(1)",
        "from drapeline.rooms import passed_on\n\npassed_on(1)",
        "class Own:\n    def method(self):\n        from drapeline.tools import helper as h\n\n"
        "        return h(1)",
    ],
)
def test_a_function_is_found_however_it_is_named(package, use):
    (package / "rooms" / "__init__.py").write_text(
        "from drapeline.tools import helper as passed_on\n"
    )
    (package.parents[1] / "one.py").write_text(use + "\n")
    tools = package / "tools.py"
    assert changed(package, replaced(tools, "x + 1", "x + 2")) == {"one"}
    assert changed(package, replaced(tools, "2 * self.x", "4 * self.x")) == {"two"}


def test_what_a_module_does_when_it_is_imported_counts_for_all_that_import_it(package):
    acting = package / "acting.py"
    acting.write_text(
        "import json\n\nVALUES = []\nVALUES.append(json)\n\n\ndef f():\n    return 1\n"
    )
    replaced(package / "tools.py", "from typing", "import drapeline.acting\nfrom typing")()
    replacement = replaced(acting, "append(json)", "append(1)")
    assert changed(package, replacement) == {"one", "two"}
    assert changed(package, replaced(acting, "return 1", "return 2")) == set()


def test_a_decorator_of_ours_may_keep_what_it_is_given(package):
    (package / "registry.py").write_text(
        "KNOWN = []\n\n\ndef register(f):\n    KNOWN.append(f)\n    return f\n"
    )
    plugin = package / "plugin.py"
    plugin.write_text(
        "from drapeline.registry import register\n\n\n@register\ndef f():\n    return 1\n"
    )
    (package.parents[1] / "one.py").write_text(
        "import drapeline.plugin\nfrom drapeline.registry import KNOWN\n\nKNOWN[0]()\n"
    )
    assert changed(package, replaced(plugin, "return 1", "return 2")) == {"one"}


@pytest.mark.parametrize(
    ("base", "imported", "scripts"),
    [
        ("Callback", "from pytorch_lightning import Callback", {"one"}),
        ("Callback", "from drapeline.rooms import Callback", {"one"}),  # passed on
        ("Module", "from torch.nn import Module", set()),  # calls `forward` alone
        ("Plain", "class Plain:\n    pass", set()),
    ],
)
def test_another_package_may_call_methods_of_its_subclasses(package, base, imported, scripts):
    (package / "rooms" / "__init__.py").write_text("from pytorch_lightning import Callback\n")
    module = package / "network.py"
    module.write_text(
        f"{imported}\n\n\nclass Base({base}):\n    x = 1\n\n\n"
        "class Network(Base):\n    def hook(self):\n        return 1\n"
    )
    (package.parents[1] / "one.py").write_text(
        "from drapeline.network import Network\n\nNetwork()\n"
    )
    assert changed(package, replaced(module, "return 1", "return 2")) == scripts


def test_a_method_may_be_named_by_a_string_or_put_together(package):
    for use in ("getattr(box, 'tripled')", "getattr(box, f'{number}d')"):
        (package.parents[1] / "one.py").write_text(
            f"from drapeline.tools import Box\n\nbox, number = Box(1), 'triple'\n{use}()\n"
        )
        edit = replaced(package / "tools.py", "3 *", "30 *")
        assert changed(package, edit) == {"one"}
        replaced(package / "tools.py", "30 *", "3 *")()


def test_a_method_that_its_own_class_puts_together_counts(package):
    module = package / "own.py"
    module.write_text(
        "class Own:\n    def call(self, x):\n        return getattr(self, f'at_{x}')()\n\n"
        "    def at_one(self):\n        return 1\n\n    def other(self):\n        return 2\n"
    )
    (package.parents[1] / "one.py").write_text("from drapeline.own import Own\n\nOwn().call(1)\n")
    assert changed(package, replaced(module, "return 1", "return 3")) == {"one"}
    assert changed(package, replaced(module, "return 2", "return 4")) == set()


def test_code_in_another_language_may_call_ours(package):
    lanes = package / "lanes.py"
    lanes.write_text(
        "def called():\n    return 1\n\n\ndef f():\n    return '''\n    called(3);\n    '''\n"
    )
    (package.parents[1] / "one.py").write_text("from drapeline.lanes import f\n\nf()\n")
    assert changed(package, replaced(lanes, "return 1", "return 2")) == {"one"}


def test_annotations_count_where_a_decorator_may_read_them(package):
    kernels = package / "kernels.py"
    kernels.write_text("import warp as wp\n\n\n@wp.kernel\ndef add(x: wp.int32):\n    x += 1\n")
    (package.parents[1] / "one.py").write_text("from drapeline.kernels import add\n\nadd\n")
    assert changed(package, replaced(kernels, "int32", "int64")) == {"one"}


def test_sentences_of_settings_do_not_count_but_defaults_do(package):
    sizes = package / "sizes.py"
    field = '    width: int = Field(4, ge=1, description="Width.")\n'
    sizes.write_text(f"from pydantic import BaseModel, Field\n\n\nclass Size(BaseModel):\n{field}")
    (package.parents[1] / "one.py").write_text("from drapeline.sizes import Size\n\nSize()\n")
    assert changed(package, replaced(sizes, "Width.", "How wide it is.")) == set()
    assert changed(package, replaced(sizes, "Field(4", "Field(5")) == {"one"}


def test_imports_for_type_checkers_alone_do_not_count(package):
    (package / "acting.py").write_text("print(1)\n")
    replaced(
        package / "tools.py",
        "from typing import NamedTuple",
        "from typing import TYPE_CHECKING, NamedTuple\n\n"
        "if TYPE_CHECKING:\n    import drapeline.acting\nelse:\n    import drapeline.rooms",
    )()
    assert changed(package, replaced(package / "acting.py", "1", "2")) == set()


@pytest.mark.parametrize(
    ("name", "scripts"),
    [("names.yaml", {"one"}), ("maps/two.yaml", {"one"}), ("other.yaml", set())],
)
def test_data_files_count_for_code_that_names_them_or_their_folder(package, name, scripts):
    rooms = package / "rooms"
    (rooms / "maps").mkdir()
    for data in ("names", "other", "maps/one", "maps/two"):
        (rooms / f"{data}.yaml").write_text("x: 1\n")
    (rooms / "reads.py").write_text(
        "def reads():\n    return 'names.yaml', 'maps'\n\n\n"
        "def unused():\n    return 'other.yaml'\n"
    )
    (package / "elsewhere").mkdir()
    (package / "elsewhere" / "d.py").write_text("NAMED = 'other.yaml'\n")
    (package.parents[1] / "one.py").write_text(
        "from drapeline.elsewhere.d import NAMED\nfrom drapeline.rooms.reads import reads\n\n"
        "reads(NAMED)\n"
    )
    assert changed(package, replaced(rooms / name, "x: 1", "x: 2")) == scripts


def test_all_of_a_module_that_a_script_is_told_of_counts(package):
    (package / "solver.py").write_text(
        "from drapeline.rooms import cloth\n\n\ndef make():\n    return cloth.a()\n"
    )
    cloth = package / "rooms" / "cloth.py"
    cloth.write_text("def a():\n    return 1\n\n\ndef b():\n    return 2\n")
    solver = "drapeline.solver"
    assert changed(package, replaced(cloth, "return 1", "return 3"), solver) == {"one", "two"}
    assert changed(package, replaced(cloth, "return 2", "return 4"), solver) == set()
    assert changed(package, replaced(cloth, "return 3", "return 5")) == set()
    with pytest.raises(FileNotFoundError, match="drapeline.nothing"):
        digests(package, "drapeline.nothing")


def test_a_module_that_is_not_there_is_an_error(package):
    (package.parents[1] / "one.py").write_text("import drapeline.nothing\n")
    with pytest.raises(FileNotFoundError, match="drapeline.nothing"):
        digests(package)


def test_imported_files_are_those_that_python_would_read(package):
    (package / "rooms" / "far.py").write_text("def far():\n    return 'one.html'\n")
    (package / "rooms" / "one.html").write_text("<p>")
    replaced(package / "tools.py", "from typing", "from drapeline.rooms import far\nfrom typing")()
    script = package.parents[1] / "one.py"
    found = Sources(package.parent).imported_files(script)
    python = {"__init__.py", "shared.py", "tools.py", "rooms/__init__.py", "rooms/far.py"}
    assert {str(path.relative_to(package)) for path in found} == python
    replaced(package / "tools.py", "return x + 1", "return far.far()")()
    found = Sources(package.parent).imported_files(script)
    assert {str(path.relative_to(package)) for path in found} == {*python, "rooms/one.html"}


def test_what_was_found_is_kept_and_changes_are_still_seen(package, tmp_path, monkeypatch):
    memory, script = tmp_path / "kept" / "sources.json", package.parents[1] / "one.py"
    first = Sources(package.parent, memory)
    before = first.digest(script)
    first.remember()
    with monkeypatch.context() as patch:
        patch.setattr(source_digest, "_parse", None)  # nothing is parsed again
        assert Sources(package.parent, memory).digest(script) == before
    replaced(package / "tools.py", "x + 1", "x + 2")()
    after = Sources(package.parent).digest(script)
    assert Sources(package.parent, memory).digest(script) == after != before


@pytest.mark.parametrize(
    "text",
    ["{", "[]", '{"x": 1}', '{"sum": "0", "tree": "", "digests": {}, "modules": {"x": 1}}'],
)
def test_a_damaged_memory_does_no_harm(package, tmp_path, text):
    memory, script = tmp_path / "sources.json", package.parents[1] / "one.py"
    memory.write_text(text)
    with_memory = Sources(package.parent, memory).digest(script)
    assert with_memory == Sources(package.parent).digest(script)


def test_a_memory_that_was_changed_does_no_harm(package, tmp_path):
    memory, script = tmp_path / "sources.json", package.parents[1] / "one.py"
    kept = Sources(package.parent, memory)
    before = kept.digest(script)
    kept.remember()
    text = memory.read_text()
    assert before in text
    memory.write_text(text.replace(before, before[::-1]))
    assert Sources(package.parent, memory).digest(script) == before
