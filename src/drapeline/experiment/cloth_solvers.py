"""The cloth solvers that there are; nothing else but its own room and a config names one."""

from typing import NamedTuple


class SolverEntry(NamedTuple):
    """A cloth solver as configs and jobs know it.

    Attributes:
        code: the module that has `cloth_solver(threads, accelerator)`.
        environment: that it runs in, a file of `envs/` without its suffix.
        uses_gpu: whether it can.
        sample_s: seconds that a sample of 60 frames takes in two tries.
    """

    code: str
    environment: str
    uses_gpu: bool
    sample_s: float


# For what is tuned to its cloth, whatever other solvers there are.
OUR_SOLVER = "drapeline.xpbd.solver"
CLOTH_SOLVERS = {
    "blender": SolverEntry("drapeline.blender.solver", "blender", False, 80),
    "xpbd": SolverEntry(OUR_SOLVER, "geometry", True, 20),
}
# Where cloth only hangs on somebody who stands still, nobody chooses.
QUICK_SOLVER = min(CLOTH_SOLVERS.values(), key=lambda solver: solver.sample_s)
