"""Snakemake with its plugins found and its command line built, as every command of it needs them.

Finding plugins takes a second: processes that begin as copies of one that has imported this module
need not look for them again.
"""

from snakemake.cli import get_argument_parser

get_argument_parser()
