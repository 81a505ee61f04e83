"""What somebody meant who asks for a file that no rule makes."""

import re
from collections.abc import Collection, Iterator, Mapping
from difflib import get_close_matches
from itertools import product
from math import prod
from pathlib import PurePosixPath

_WILDCARD = re.compile(r"\{(\w+)\}")
_ALIKE = 0.7  # of two names, at least, for one to be meant by the other
_EXPANDED = 2000  # files of one pattern that a target is compared with
Patterns = Mapping[str, Mapping[str, str]]  # "a/{b}.png" -> {"b": regular expression of its values}


def explain_target(target: str, rules: Collection[str], patterns: Patterns) -> str:
    """Why nothing makes a target, and the nearest that can be made; empty if something makes it.

    Args:
        target: a path or the name of a rule.
        rules: names that can be asked for.
        patterns: of the files that rules make.
    """
    regexes = [_regex(pattern, constraints) for pattern, constraints in patterns.items()]

    def is_made(path: str) -> bool:
        return any(regex.fullmatch(path) for regex in regexes)

    if target in rules or is_made(target):
        return ""
    for folder in map(str, PurePosixPath(target).parents):
        if is_made(folder):
            return f"{target} lies in a folder that is made as a whole; ask for {folder}"
    files = list(_files(patterns))
    names = {PurePosixPath(file).name: file for file in files}
    near = (
        get_close_matches(target, rules, n=1, cutoff=_ALIKE)
        or get_close_matches(target, files, n=1, cutoff=_ALIKE)
        or [names[n] for n in get_close_matches(target, names, n=1, cutoff=_ALIKE)]
    )
    return f"nothing makes {target}" + (f"; did you mean {near[0]}?" if near else "")


def _regex(pattern: str, constraints: Mapping[str, str]) -> re.Pattern[str]:
    text, seen = "", set()
    for number, piece in enumerate(_WILDCARD.split(pattern)):
        if number % 2 == 0:
            text += re.escape(piece)
        elif piece in seen:
            text += f"(?P={piece})"
        else:
            seen.add(piece)
            text += f"(?P<{piece}>{constraints.get(piece, '.+')})"
    return re.compile(text)


def _files(patterns: Patterns) -> Iterator[str]:
    """Files of patterns whose constraints list the values of wildcards; other patterns as such."""
    for pattern, constraints in patterns.items():
        names = list(dict.fromkeys(_WILDCARD.findall(pattern)))
        values = [_listed(constraints.get(name, ".+")) for name in names]
        if not 0 < prod(map(len, values)) <= _EXPANDED:
            yield pattern
            continue
        for chosen in product(*values):
            yield pattern.format(**dict(zip(names, chosen, strict=True)))


def _listed(constraint: str) -> list[str]:
    """The values that a constraint lists; none where it is not a list."""
    values = [re.sub(r"\\(\W)", r"\1", value) for value in constraint.split("|")]
    return [] if any(re.search(r"[\\()\[\]+*?]", value) for value in values) else values
