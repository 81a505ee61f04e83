"""Which code a rule's script runs: a digest that changes when its results may change.

What counts are the definitions that a script reaches by name: functions, classes, their methods,
constants, and what modules do when they are imported. Where a file ends does not matter, nor do
comments, docstrings, the annotations of plain functions and the sentences of settings.
"""

import ast
import hashlib
import json
import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

from drapeline.errors import InputError
from drapeline.storage import read_json, write_json

PACKAGE = "drapeline"
DATA_SUFFIXES = {".html", ".yaml"}
# Bases of other packages that call but these methods by their names.
_CALLED_BY_BASE = {
    **dict.fromkeys(("ABC", "Enum", "Generic", "IntEnum", "NamedTuple", "Protocol"), ()),
    "Module": ("forward", "train", "_apply", "_load_from_state_dict", "_save_to_state_dict"),
}
# Decorators that neither keep what they decorate nor read its annotations.
_PLAIN_DECORATORS = {
    *("abstractmethod", "cached_property", "classmethod", "contextmanager", "inference_mode"),
    *("no_grad", "property", "staticmethod"),
}
# Calls that look names up in a way that cannot be followed.
_UNTRACEABLE = {"__import__", "eval", "exec", "globals", "import_module"}
_FILE_NAME = re.compile(r"[\w.-]+")
_WORD = re.compile(r"[A-Za-z_]\w*")
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


class Sources:
    """The package's files as they are now. Each is read once, since most serve many rules.

    Args:
        folder: holds the package's folder.
        memory: JSON file that keeps digests and parsed files from one run to the next, because
            parsing takes seconds; None keeps nothing. A file that cannot be read or written is
            ignored.
    """

    def __init__(self, folder: str | Path, memory: str | Path | None = None) -> None:
        self._folder = Path(folder)
        self._memory = None if memory is None else Path(memory)
        self._texts = {
            path: path.read_text()
            for path in sorted((self._folder / PACKAGE).rglob("*"))
            if path.suffix in {".py", *DATA_SUFFIXES}
        }
        files = [[str(path.relative_to(self._folder)), text] for path, text in self._texts.items()]
        self._tree = _sum([_reader(), files])
        known = _load_memory(self._memory)
        self._parsed = known["modules"]
        self._digests = known["digests"] if known["tree"] == self._tree else {}
        self._remembered = self._tree == known["tree"]
        self.module = cache(self._read_module)
        self.file = cache(self._find_file)
        self.files_of_import = cache(self._find_files_of_import)
        self.links = cache(self._find_links)
        self.called_by_bases = cache(self._find_called_by_bases)
        self._entry = cache(self._make_entry)
        self._data_below = cache(self._find_data_below)

    def digest(self, script: str | Path, *named: str) -> str:
        """Digest of a script and of all of the package that it reaches.

        Code that moves to another file and stays as it is leaves the digest as it was.

        Args:
            script: a Python file that imports from the package.
            named: what it imports without naming it in its text: `package.module`, all of which
                counts, or `package.module:definition`; of another package all files count.

        Returns:
            Twelve hexadecimal digits.

        Raises:
            FileNotFoundError: an import of the package names no module.
        """
        others = [path.read_text() for name in named for path in _files_of_others(name)]
        key = _sum([Path(script).read_text(), named, others])
        if key not in self._digests:
            reached = _Reached(self, Path(script), named)
            data = (self._texts[path] for path in reached.data_files())
            self._digests[key] = _sum(sorted({*map(self._entry, reached.nodes), *data}))
            self._remembered = False
        return self._digests[key]

    def imported_files(self, script: str | Path, *named: str) -> set[Path]:
        """Files of the package that a script uses.

        They are the modules that it imports, directly or through others, and the data files (YAML,
        HTML) beside or below such a module that code which is reached there names: by their own
        name or by that of a folder that holds them.

        Args:
            script: a Python file that imports from the package.
            named: see `digest`.
        """
        reached = _Reached(self, Path(script), named)
        return {path for path in reached.loaded if path in self._texts} | reached.data_files()

    def remember(self) -> None:
        """Keep what was found out for the next run."""
        if self._memory is None or self._remembered:
            return
        texts = (text for path, text in self._texts.items() if path.suffix == ".py")
        keys = {_module_key(text) for text in texts}
        modules = {key: module for key, module in self._parsed.items() if key in keys}
        kept = {"tree": self._tree, "digests": self._digests, "modules": modules}
        with suppress(OSError):
            self._memory.parent.mkdir(parents=True, exist_ok=True)
            write_json(self._memory, {"sum": _sum(kept), **kept})

    def data_files(self, module: Path, names: Iterable[str]) -> set[Path]:
        """Data files beside or below a module that have one of these names, or whose folder has."""
        below = self._data_below(module.parent)
        return {path for path, parts in below.items() if not parts.isdisjoint(names)}

    def all_nodes(self, path: Path) -> "Iterator[_Node]":
        """Everything in a module."""
        for index, definition in enumerate(self.module(path).definitions):
            yield _Node(path, index, "")
            yield from (_Node(path, index, method) for method in definition.methods)

    def definition(self, path: Path, name: str) -> "tuple[_Node, ...]":
        """What a name in a module means; nothing for one that is not there."""
        target = self._resolve(path, name) if name else None
        return target.nodes if target else ()

    def piece(self, node: "_Node") -> "_Piece":
        """The code of a node."""
        definition = self.module(node.path).definitions[node.place]
        return definition.methods[node.method] if node.method else definition.piece

    def _read_module(self, path: Path) -> "_Module":
        text = self._texts[path] if path in self._texts else path.read_text()
        key = _module_key(text)
        if key not in self._parsed:
            self._parsed[key] = _parse(text)
            self._remembered = False
        return _Module.of(self._parsed[key])

    def _find_file(self, name: str) -> Path | None:
        base = self._folder.joinpath(*name.split("."))
        candidates = (base.with_suffix(".py"), base / "__init__.py")
        return next((path for path in candidates if path in self._texts), None)

    def _find_files_of_import(self, module: str, name: str) -> list[Path]:
        """Files that are executed by an import, those of the packages around the module first.

        Raises:
            FileNotFoundError: there is no such module of the package.
        """
        if not _is_ours(module):
            return []
        if name and self.file(f"{module}.{name}"):
            module = f"{module}.{name}"
        if self.file(module) is None:
            raise FileNotFoundError(f"{module}: no such module under {self._folder}")
        parts = module.split(".")
        around = (self.file(".".join(parts[: count + 1])) for count in range(len(parts)))
        return [path for path in around if path]

    def _find_data_below(self, folder: Path) -> dict[Path, set[str]]:
        return {
            path: set(path.relative_to(folder).parts)
            for path in self._texts
            if path.suffix in DATA_SUFFIXES and path.is_relative_to(folder)
        }

    def _find_links(self, node: "_Node") -> "dict[str, _Target]":
        """What names mean that are used in a node, but for those of builtins and locals."""
        piece = self.piece(node)
        local = {name: origin for name, *origin in piece.imports}
        return {
            name: target
            for name in piece.names
            if (target := self._resolve(node.path, name, local)) is not None
        }

    def _resolve(
        self, path: Path, name: str, local: Mapping[str, list[str]] | None = None
    ) -> "_Target | None":
        module = self.module(path)
        first, *rest = name.split(".")
        nodes = [_Node(path, index, "") for index in module.places(first)]
        origin = (local or {}).get(first) or module.bound.get(first)
        if origin is None:
            found = [self._walk(star, [first, *rest]) for star in module.stars]
        elif origin[0].split(".")[0] != PACKAGE:
            return _Target(":".join(origin), tuple(nodes))
        else:
            found = [self._walk(origin[0], [*filter(None, origin[1:]), *rest])]
        nodes += chain.from_iterable(target.nodes for target in found)
        outside = " ".join(target.outside for target in found)
        return _Target(outside, tuple(nodes)) if nodes or outside else None

    def _walk(self, module: str, parts: list[str]) -> "_Target":
        """What `module.part.part` means: a definition, or all of a module."""
        while parts and self.file(f"{module}.{parts[0]}"):
            module, parts = f"{module}.{parts[0]}", parts[1:]
        path = self.file(module)
        if path is None:
            raise FileNotFoundError(f"{module}: no such module under {self._folder}")
        target = self._resolve(path, parts[0]) if parts else None
        return target or _Target("", tuple(self.all_nodes(path)))

    def _find_called_by_bases(self, node: "_Node") -> set[str]:
        """Methods of a class that other packages call by their names; "*" for perhaps all."""
        definition, called = self.module(node.path).definitions[node.place], set[str]()
        for base in definition.bases:
            target = self._resolve(node.path, base) if base else _Target("?", ())
            if target is None:  # a builtin
                continue
            if target.outside:
                called.update(_CALLED_BY_BASE.get(base.split(".")[-1], "*"))
            for one in target.nodes:
                if not one.method:
                    called |= self.called_by_bases(one)
        return called

    def _make_entry(self, node: "_Node") -> str:
        """What a node adds to a digest: its code and what the names in it mean, not where it is."""
        owner = self.piece(node._replace(method="")).code if node.method else ""
        meanings = [
            [name, target.outside, sorted(self.piece(one).code for one in target.nodes)]
            for name, target in sorted(self.links(node).items())
        ]
        return json.dumps([owner, self.piece(node).code, meanings])


class _Node(NamedTuple):
    """A definition of a module, or a method of a class."""

    path: Path  # of the module
    place: int  # of its definition among those of the module
    method: str  # name, or ""


class _Target(NamedTuple):
    """What a name means."""

    outside: str  # where it comes from if it is of another package, else ""
    nodes: tuple[_Node, ...]  # of the package


class _Reached:
    """What is reached from a script.

    Attributes:
        nodes: definitions and methods, each once.
        loaded: modules that are imported, and the script.
    """

    def __init__(self, sources: Sources, script: Path, named: Iterable[str]) -> None:
        self._sources = sources
        self.loaded: set[Path] = set()
        self.nodes: dict[_Node, None] = {}
        self._waiting: list[_Node] = []
        # Methods are reached by their names, whatever object they are looked up in.
        self._words: set[str] = set()
        self._patterns: set[str] = set()
        self._unused: defaultdict[str, list[_Node]] = defaultdict(list)
        self._load(script)
        self._add(sources.all_nodes(script))
        for name in named:
            for path in _files_of_others(name):
                self._load(path)
                self._add(sources.all_nodes(path))
            module, _, definition = name.partition(":")
            for path in sources.files_of_import(module, "")[-1:]:
                self._load(path)
                self._add(sources.definition(path, definition) or sources.all_nodes(path))
        while self._waiting:
            self._follow(self._waiting.pop())

    def data_files(self) -> set[Path]:
        """Data files that reached code names."""
        names = defaultdict(set)
        for node in self.nodes:
            names[node.path].update(self._sources.piece(node).strings)
        return set().union(*(self._sources.data_files(*item) for item in names.items()))

    def _add(self, nodes: Iterable[_Node]) -> None:
        for node in nodes:
            if node not in self.nodes:
                self.nodes[node] = None
                self._waiting.append(node)

    def _follow(self, node: _Node) -> None:
        piece = self._sources.piece(node)
        self._load(node.path)
        for _, *origin in piece.imports:
            self._load(*self._sources.files_of_import(*origin))
        for target in self._sources.links(node).values():
            self._add(target.nodes)
        if piece.untraceable:
            self._add(self._sources.all_nodes(node.path))
        self._look_up({*piece.attributes, *piece.strings} - self._words, piece.patterns)
        if not node.method:
            self._offer_methods(node)

    def _look_up(self, words: set[str], patterns: Iterable[str]) -> None:
        self._words |= words
        self._patterns.update(patterns)
        for word in words & self._unused.keys():
            self._add(self._unused.pop(word))
        for word in [w for w in self._unused if any(re.fullmatch(p, w) for p in patterns)]:
            self._add(self._unused.pop(word))

    def _offer_methods(self, node: _Node) -> None:
        definition = self._sources.module(node.path).definitions[node.place]
        called = self._sources.called_by_bases(node).union(definition.called)
        for name in definition.methods:
            method = node._replace(method=name)
            if (
                name in self._words
                or not called.isdisjoint((name, "*"))
                or any(re.fullmatch(pattern, name) for pattern in self._patterns)
            ):
                self._add([method])
            else:
                self._unused[name].append(method)

    def _load(self, *paths: Path) -> None:
        """What modules do when they are imported counts, whether or not their names are used."""
        for path in paths:
            if path in self.loaded:
                continue
            self.loaded.add(path)
            module = self._sources.module(path)
            for origin in module.loads:
                self._load(*self._sources.files_of_import(*origin))
            acting = (i for i, definition in enumerate(module.definitions) if definition.acts)
            self._add(_Node(path, index, "") for index in acting)


class _Piece(NamedTuple):
    """Code that counts as a whole."""

    code: str  # hash of its text
    names: list[str]  # dotted names that it uses, such as "np.array"
    attributes: list[str]  # names that follow a dot
    strings: list[str]  # constants that may name a file, a folder or an attribute
    patterns: list[str]  # regular expressions of attributes whose names are put together
    imports: list[list[str]]  # of its own: the name here, the module, the name there
    untraceable: bool  # whether it looks names up in a way that cannot be followed


class _Definition(NamedTuple):
    """A statement of a module."""

    binds: list[str]  # names that it gives a meaning
    piece: _Piece  # its code, without methods
    methods: dict[str, _Piece]  # of a class
    called: list[str]  # names of methods that may be called without being named
    bases: list[str]  # of a class, dotted names; "" for what is none
    acts: bool  # whether it does more than giving names a meaning


class _Module(NamedTuple):
    """What counts of a Python file."""

    # Name -> module and name that it is imported from; the latter is "" for modules.
    bound: dict[str, list[str]]
    stars: list[str]  # modules of which all names are imported
    loads: list[list[str]]  # the imports of the package, as module and name
    definitions: list[_Definition]  # all other statements
    names: dict[str, list[int]]  # name -> indices of its definitions

    def places(self, name: str) -> list[int]:
        """Indices of the definitions of a name."""
        return self.names.get(name, [])

    @classmethod
    def of(cls, kept: Mapping[str, Any]) -> "_Module":
        """From what `_parse` returned, perhaps by way of JSON."""
        definitions = [
            _Definition(binds, _Piece(*piece), {k: _Piece(*v) for k, v in methods.items()}, *rest)
            for binds, piece, methods, *rest in kept["definitions"]
        ]
        names: dict[str, list[int]] = {}
        for index, definition in enumerate(definitions):
            for name in definition.binds:
                names.setdefault(name, []).append(index)
        return cls(kept["bound"], kept["stars"], kept["loads"], definitions, names)


def _parse(text: str) -> dict[str, Any]:
    """A module as plain lists and mappings, see `_Module`."""
    statements = _without_type_checking(_without_docstring(ast.parse(text).body))
    own = {name for statement in statements for name in _binds(statement)}
    origins = [origin for one in statements if _is_import(one) for origin in _origins(one)]
    definitions = [_definition(one, own, origins) for one in statements if not _is_import(one)]
    for definition in definitions:
        if definition.acts:  # perhaps imports only if it can
            origins += definition.piece.imports
    return {
        "bound": {local: origin for local, *origin in origins if local},
        "stars": [module for _, module, name in origins if name == "*"],
        "loads": [origin for _, *origin in origins if _is_ours(origin[0])],
        "definitions": definitions,
    }


def _definition(statement: ast.stmt, own: set[str], origins: list[list[str]]) -> _Definition:
    binds, methods, called, bases = _binds(statement), {}, [], []
    decorators = {_dotted(d) for d in getattr(statement, "decorator_list", [])}
    ours = own.union(local for local, module, _ in origins if _is_ours(module))
    listed = any(decorator.split(".")[0] in ours for decorator in decorators)
    plain = isinstance(statement, (*_FUNCTIONS, ast.ClassDef, ast.Assign, ast.AnnAssign)) and binds
    if isinstance(statement, ast.ClassDef):
        named = [b.value if isinstance(b, ast.Subscript) else b for b in statement.bases]
        bases = [*map(_dotted, named)]
        bases += ["" for _ in statement.keywords]
        grouped: dict[str, list[ast.stmt]] = {}
        patterns = _own_patterns(statement)
        for part in (part for part in statement.body if isinstance(part, _FUNCTIONS)):
            grouped.setdefault(part.name, []).append(part)
            looked_up = any(re.fullmatch(pattern, part.name) for pattern in patterns)
            if part.name.startswith("__") or looked_up or not _is_plain(part):
                called.append(part.name)
        methods = {name: _piece(parts, own) for name, parts in grouped.items()}
        statement.body = [part for part in statement.body if not isinstance(part, _FUNCTIONS)]
    piece = _piece([statement], own)
    return _Definition(binds, piece, methods, called, bases, listed or not plain)


def _piece(statements: list[ast.stmt], own: set[str]) -> _Piece:
    imports: list[list[str]] = []
    statements = _strip(statements, imports)
    names, attributes, strings, patterns = (set[str]() for _ in range(4))
    within: set[int] = set()  # parts of longer dotted names
    untraceable = any(name == "*" for _, _, name in imports)
    for node in chain.from_iterable(map(ast.walk, statements)):
        match node:
            case ast.Attribute(value=value, attr=name):
                attributes.add(name)
                within.add(id(value))
                if id(node) not in within or not _dotted(node):
                    names.add(_dotted(node))
            case ast.Name(id=name) if id(node) not in within:
                names.add(name)
            case ast.Constant(value=str(value)) if "\n" in value:  # perhaps code that calls ours
                names.update(own.intersection(_WORD.findall(value)))
            case ast.Constant(value=str(value)) if _FILE_NAME.fullmatch(value):
                strings.add(value)
            case ast.Call(func=ast.Name("getattr"), args=[ast.Name("self"), ast.JoinedStr(), *_]):
                pass  # see `_own_patterns`
            case ast.Call(func=ast.Name("getattr"), args=[_, ast.JoinedStr(values=parts), *_]):
                patterns.add(_pattern(parts))
            case ast.Call(args=[ast.Constant(value=str(module)), *_]) if _looks_up(node):
                imports.append([module.split(".")[0], module.split(".")[0], ""])
                names.add(module)
            case ast.Call() if _looks_up(node):
                untraceable = True
    text = "\n".join(map(ast.unparse, statements))
    used = [sorted(found - {""}) for found in (names, attributes, strings, patterns)]
    return _Piece(_sum(text), used[0], used[1], used[2], used[3], imports, untraceable)


def _looks_up(call: ast.Call) -> bool:
    """Whether a call looks a name up; `model.eval()` does not."""
    name = _dotted(call.func)
    return name in _UNTRACEABLE or name == "importlib.import_module"


def _own_patterns(statement: ast.ClassDef) -> list[str]:
    """Regular expressions of names that a class puts together to look them up in itself."""
    found = []
    for node in ast.walk(statement):
        match node:
            case ast.Call(
                func=ast.Name("getattr"), args=[ast.Name("self"), ast.JoinedStr(values=parts), *_]
            ):
                found.append(_pattern(parts))
    return found


def _pattern(parts: list[ast.expr]) -> str:
    return "".join(
        re.escape(str(part.value)) if isinstance(part, ast.Constant) else ".*" for part in parts
    )


def _dotted(node: ast.AST) -> str:
    """A chain of names and dots as text, of a call that of what is called; "" for what is none."""
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=ast.Name() | ast.Attribute() as value, attr=name):
            start = _dotted(value)
            return start and f"{start}.{name}"
        case ast.Call(func=called):
            return _dotted(called)
    return ""


@cache
def _files_of_others(name: str) -> list[Path]:
    """All files of the package of a `package.module:definition`, unless that is ours."""
    package = name.partition(":")[0].split(".")[0]
    found = None if _is_ours(package) else find_spec(package)
    if found is None:
        return []
    folders = [Path(folder) for folder in found.submodule_search_locations or ()]
    files = [path for folder in folders for path in sorted(folder.rglob("*.py"))]
    return files or [Path(origin) for origin in [found.origin] if origin]


def _is_ours(module: str) -> bool:
    return module.split(".")[0] == PACKAGE


def _is_import(statement: ast.stmt) -> TypeGuard[ast.Import | ast.ImportFrom]:
    return isinstance(statement, ast.Import | ast.ImportFrom)


def _origins(statement: ast.Import | ast.ImportFrom) -> list[list[str]]:
    """What an import binds: the name here, the module, and the name there, "" for a module."""
    found = []
    for alias in statement.names:
        if isinstance(statement, ast.ImportFrom):
            found.append([alias.asname or alias.name, statement.module or "", alias.name])
        elif alias.asname:
            found.append([alias.asname, alias.name, ""])
        else:
            first = alias.name.split(".")[0]
            found += [[first, first, ""], ["", alias.name, ""]]
    return found


def _binds(statement: ast.stmt) -> list[str]:
    """Names that a statement of a module gives a meaning, but for those that it imports."""
    if isinstance(statement, (*_FUNCTIONS, ast.ClassDef)):
        return [statement.name]
    if isinstance(statement, ast.Assign | ast.AnnAssign):
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        parts = [part for target in targets for part in getattr(target, "elts", [target])]
        whole = all(isinstance(part, ast.Name | ast.Starred) for part in parts)
        return [_dotted(getattr(part, "value", part)) for part in parts] if whole else []
    return [
        node.id if isinstance(node, ast.Name) else node.name
        for node in ast.walk(statement)
        if isinstance(node, (*_FUNCTIONS, ast.ClassDef))
        or (isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store))
    ]


def _strip(body: list[ast.stmt], imports: list[list[str]]) -> list[ast.stmt]:
    """Statements without what has no effect: docstrings, imports of the package, annotations, and
    the sentences of settings.

    Args:
        body: is changed.
        imports: the imports within are added to it.
    """
    kept: list[ast.stmt] = []
    for statement in _without_type_checking(body):
        if _is_import(statement):
            origins = _origins(statement)
            imports += origins
            if not _is_ours(origins[0][1]):
                kept.append(statement)
            continue
        if isinstance(statement, (*_FUNCTIONS, ast.ClassDef)):
            statement.body = _without_docstring(statement.body)
        match statement:
            case ast.AnnAssign(value=ast.Call(func=ast.Name("Field"), keywords=told) as field):
                field.keywords = [one for one in told if one.arg != "description"]
        if isinstance(statement, _FUNCTIONS) and _is_plain(statement):
            _remove_annotations(statement)
        for part in (statement, *getattr(statement, "handlers", getattr(statement, "cases", []))):
            for name in ("body", "orelse", "finalbody"):
                if inner := getattr(part, name, None):
                    setattr(part, name, _strip(inner, imports) or [ast.Pass()])
        kept.append(statement)
    return kept


def _without_docstring(body: list[ast.stmt]) -> list[ast.stmt]:
    match body:
        case [ast.Expr(ast.Constant(value=str())), *rest]:
            return rest or [ast.Pass()]
    return body


def _without_type_checking(body: list[ast.stmt]) -> list[ast.stmt]:
    found: list[ast.stmt] = []
    for statement in body:
        if isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.unparse(statement.test):
            found += statement.orelse
        else:
            found.append(statement)
    return found


def _is_plain(function: Any) -> bool:
    """Whether no decorator reads annotations, as those of kernels do, or lists what it is given."""
    return {_dotted(d).split(".")[-1] for d in function.decorator_list} <= _PLAIN_DECORATORS


def _remove_annotations(function: Any) -> None:
    arguments = function.args
    function.returns = None
    for one in (
        *(*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs),
        *filter(None, (arguments.vararg, arguments.kwarg)),
    ):
        one.annotation = None


def _sum(value: Any) -> str:
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()[:16]


@cache
def _reader() -> str:
    """Names this code and this interpreter: others print the same code differently."""
    return _sum([sys.version, Path(__file__).read_text()])


def _module_key(text: str) -> str:
    return _sum([_reader(), text])


def _load_memory(memory: Path | None) -> dict[str, Any]:
    nothing: dict[str, Any] = {"tree": "", "digests": {}, "modules": {}}
    if memory is None:
        return nothing
    try:
        kept = read_json(memory, {"sum": str, "tree": str, "digests": dict, "modules": dict})
    except InputError:
        return nothing
    # Of a damaged file, or one that another version kept, all is found out anew.
    whole = kept.pop("sum") == _sum(kept)
    return kept if whole else nothing
