"""Run the tiny experiment on a Slurm cluster of two nodes, all on this computer.

    PYTHONPATH=src:tests python tests/cluster/slurm.py FOLDER [--seed 0] [--longest 120]

Sets up a cluster on the loopback interface with the Slurm profile's own settings: a controller, two
nodes of one core each, and no accounting. A job is cancelled, later Snakemake itself is killed, and
the run is started again with what docs/how-to/run-elsewhere.md says to type. Prints what was
disturbed, then counts: arrays that differ from those of a local run (which is made first, and kept
in FOLDER for later calls), files of killed jobs that are left over, tracebacks on the terminal.
Exits with 1 if there is any of the first two.

Needs root and Debian's packages `slurm-wlm` and `munge`. All files of the cluster are in FOLDER,
and its processes are ended with the script. Takes half an hour or so; CI does not run it.
"""

import argparse
import contextlib
import os
import random
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from survive import (
    CONFIG,
    LONGEST_S,
    SNAKEMAKE,
    examine,
    fresh,
    reference,
    say,
    start,
)

NODES = ("node1", "node2")
# Quick checks of the state of jobs, since those of tiny take seconds; and as many threads as the
# local run has, with which sums are to the bit as there.
RUN = [
    *("all", *CONFIG, "--workflow-profile", "workflow/profiles/slurm"),
    *("--slurm-init-seconds-before-status-checks", "3", "--max-threads", "1"),
]
SETTINGS = """\
ClusterName=loopback
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
MpiDefault=none
ReturnToService=2
SlurmdParameters=config_overrides
{nodes}
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def free_ports(count: int) -> list[int]:
    """Ports of the loopback interface that nobody listens to."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


def write_settings(folder: Path) -> None:
    """`slurm.conf`, and the key by which the cluster's processes know one another."""
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("munge", "state", *NODES):
        (folder / name).mkdir(parents=True)
    (folder / "munge/key").write_bytes(random.SystemRandom().randbytes(1024))
    (folder / "munge/key").chmod(0o400)
    host, ports = socket.gethostname().split(".")[0], free_ports(1 + len(NODES))
    # Slurm believes in this memory, and limits nobody to it.
    nodes = "\n".join(
        f"NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={port}"
        " CPUs=1 RealMemory=16000"
        for name, port in zip(NODES, ports[1:], strict=True)
    )
    text = SETTINGS.format(host=host, ports=ports, folder=folder, nodes=nodes)
    (folder / "slurm.conf").write_text(text)


def slurm(*command: str) -> str:
    """What one of Slurm's commands prints."""
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


@contextlib.contextmanager
def cluster(folder: Path) -> Iterator[None]:
    """A cluster on this computer; Slurm's commands find it by the environment."""
    write_settings(folder)
    os.environ["SLURM_CONF"] = f"{folder}/slurm.conf"
    files = {"key-file": "key", "socket": "socket", "pid-file": "pid", "seed-file": "seed"}
    munge = [f"--{option}={folder}/munge/{name}" for option, name in files.items()]
    daemons = []
    try:
        for name, command in (
            ("munged", ["munged", "--foreground", "--force", *munge]),
            ("slurmctld", ["slurmctld", "-D"]),
            *((node, ["slurmd", "-D", "-N", node]) for node in NODES),
        ):
            with open(folder / f"{name}.log", "wb") as stream:
                daemons.append(subprocess.Popen(command, stdout=stream, stderr=stream))
            time.sleep(1)
        _wait_until(lambda: slurm("sinfo", "-h", "-o", "%D %t") == f"{len(NODES)} idle")
        yield
    finally:
        with contextlib.suppress(subprocess.CalledProcessError):
            cancel_all()
        for daemon in reversed(daemons):
            daemon.terminate()
        for daemon in reversed(daemons):
            daemon.wait(60)


def _wait_until(holds, longest_s: float = 60) -> None:
    until = time.monotonic() + longest_s
    while not holds():
        if time.monotonic() > until:
            sys.exit("the cluster does not answer as it should, see the logs in FOLDER/cluster")
        time.sleep(1)


def cancel_all() -> None:
    """Cancel all jobs, and wait until none is left."""
    slurm("scancel", "--user", "root")
    _wait_until(lambda: not slurm("squeue", "-h"))


def cancel_one(rng: random.Random) -> str:
    """Cancel a running job; its name, as its comment says, or nothing if none is running."""
    running = slurm("squeue", "-h", "-t", "RUNNING", "-o", "%i %k").splitlines()
    if not running:
        return ""
    number, name = rng.choice(running).split(" ", 1)
    slurm("scancel", number)
    return name


def disturb(project: Path, rng: random.Random, longest_s: float) -> int:
    """Run the experiment, disturbed twice; the number of disturbances."""
    process = start(project, RUN)
    done = 0
    for what in ("a job is cancelled", "Snakemake is killed"):
        wait_s = rng.uniform(longest_s / 2, longest_s)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(wait_s)
            break
        if what == "a job is cancelled":
            what = f"{cancel_one(rng) or 'no job'} is cancelled"
        else:
            process.kill()
            process.wait()
            # What the documentation says to type.
            cancel_all()
            subprocess.run([SNAKEMAKE, "--unlock", *CONFIG], cwd=project, check=True)
            process = start(project, RUN)
        done += 1
        say(f"{what} after {wait_s:.0f} s")
    if process.wait(LONGEST_S):
        sys.exit(f"the run failed, see {project}/output.txt")
    return done


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--longest", type=float, default=120, help="seconds until a disturbance")
    given = parser.parse_args(arguments)
    folder = given.folder.resolve()
    say(f"local run: {(reference(folder) / 'done').read_text().strip()}")
    project = fresh(folder, "slurm")
    with cluster(folder / "cluster"):
        began = time.monotonic()
        done = disturb(project, random.Random(given.seed), given.longest)
        say(f"run on the cluster: {time.monotonic() - began:.0f} s")
    counts = examine(folder, project, "all", done)
    return 1 if counts.different or counts.leftovers else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
