"""The command `drapeline`."""

import argparse
import logging
import sys
from importlib import import_module

from drapeline import __version__
from drapeline.errors import InputError

_COMMANDS = {
    "dress": "dress somebody in a motion of yours, as glTF, a page, a picture, USD, OBJ or PC2",
    "check-config": "say whether the workflow takes a config, without running it",
    "check": "measure clothes in motion from anywhere: inside the body, crossings, stretch, slip",
}
_EPILOG = (
    "drapeline as a whole runs as a Snakemake workflow, for instance 'snakemake dataset --cores"
    " all' in its folder; README.md says more."
)


def main() -> None:
    """Read the command line and do what it says."""
    logging.basicConfig(format="%(message)s", stream=sys.stderr)
    logging.getLogger("drapeline").setLevel(logging.INFO)
    try:
        sys.exit(_run(sys.argv[1:]))
    except (InputError, OSError) as error:
        sys.exit(f"drapeline: {error}")
    except ModuleNotFoundError as error:
        if "drapeline[" in str(error):  # it says itself what brings it
            sys.exit(f"drapeline: {error}")
        extra = "pipeline" if sys.argv[1:2] == ["check-config"] else "dress"
        sys.exit(
            f"drapeline: needs {error.name}, which is not installed; expected drapeline with the"
            f" extra [{extra}]: pip install 'drapeline[{extra}]'"
        )
    except KeyboardInterrupt:
        sys.exit(130)


def _run(words: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="drapeline",
        description="From motion capture to simulated clothes.",
        epilog=_EPILOG,
    )
    parser.add_argument("--version", action="version", version=f"drapeline {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    for name, about in _COMMANDS.items():
        if words[:1] != [name]:
            commands.add_parser(name, help=about)
            continue
        # Only what is asked for is imported.
        module = import_module(f"drapeline.commands.{name.replace('-', '_')}")
        module.add_arguments(commands.add_parser(name, help=about, description=module.__doc__))
    args = parser.parse_args(words)
    if args.command is None:
        parser.print_help()
        return 0
    return import_module(f"drapeline.commands.{args.command.replace('-', '_')}").run(args)


if __name__ == "__main__":
    main()
