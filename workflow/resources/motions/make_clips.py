"""Recreate the clips of this folder from a pybullet wheel.

pip download --no-deps pybullet==3.2.7
python workflow/resources/motions/make_clips.py pybullet-3.2.7-*.whl
"""

import sys
from pathlib import Path

from drapeline.motions.clips import write_clips

if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: make_clips.py WHEEL")
    for line in write_clips(Path(sys.argv[1]), Path(__file__).parent):
        print(line)
