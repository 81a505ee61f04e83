import subprocess
import sys

MESH = """
import os
import numpy as np
from drapeline.geometry.warp_mesh import start_warp, warp_mesh

mesh = warp_mesh(np.eye(3), np.array([[0, 1, 2]]))
assert mesh.points.numpy().tolist() == np.eye(3).tolist()
start_warp()
os.write(2, b"said afterwards")
"""


def test_warp_starts_without_a_word_and_gives_the_terminal_back():
    done = subprocess.run([sys.executable, "-c", MESH], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert (done.stdout, done.stderr) == ("", "said afterwards")
