"""`drapeline --version`; drapeline itself runs as a Snakemake workflow."""

import argparse

from drapeline import __version__


def main() -> None:
    """Read the command line and print the version or the help."""
    parser = argparse.ArgumentParser(
        prog="drapeline",
        description="drapeline runs as a Snakemake workflow, for instance"
        " 'snakemake dataset --cores all' in its folder; README.md says more.",
    )
    parser.add_argument("--version", action="version", version=f"drapeline {__version__}")
    parser.parse_args()
    parser.print_help()


if __name__ == "__main__":
    main()
