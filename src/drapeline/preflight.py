"""Check what this machine lacks before anything is installed or run: one sentence per problem.

Needs nothing but Python 3: `python src/drapeline/preflight.py`.
"""

import ctypes
import platform
import shutil
import subprocess
import sys

# Shared libraries that Blender's wheel links to, and the Debian packages that provide them.
SYSTEM_LIBRARIES = {
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libXext.so.6": "libxext6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
}
DISK_GB = 8
# Snakemake asks for the state of jobs every three minutes at least.
REMEMBERED_S = 200


def missing_libraries(names):
    """Names of the shared libraries that the dynamic linker cannot load."""
    missing = []
    for name in names:
        try:
            ctypes.CDLL(name)
        except OSError:
            missing.append(name)
    return missing


def find_problems(folder, version=None, system=None, libraries=None, free_gb=None):
    """List what the machine lacks, one sentence each; empty if it has everything.

    Args:
        folder: where the environment and the results will be.
        version, system, libraries, free_gb: replace the machine's own values in tests.
    """
    version = version or tuple(sys.version_info[:2])
    system = system or platform.system()
    libraries = SYSTEM_LIBRARIES if libraries is None else libraries
    free_gb = shutil.disk_usage(folder).free / 1e9 if free_gb is None else free_gb
    problems = []
    if tuple(version) != (3, 11):
        problems.append(
            "Python {}.{} is running, but the locked versions are those for Python 3.11;"
            " choose it with 'make PYTHON=/path/to/python3.11'.".format(*version)
        )
    if system == "Linux":
        missing = missing_libraries(libraries)
        if missing:
            problems.append(
                "Blender needs the system libraries {}, which are not installed;"
                " on Debian or Ubuntu: apt-get install {}.".format(
                    ", ".join(missing), " ".join(libraries[name] for name in missing)
                )
            )
    if free_gb < DISK_GB:
        problems.append(
            f"{folder} has only {free_gb:.1f} GB of free disk space,"
            f" but the environment and a default run need {DISK_GB} GB."
        )
    return problems


def slurm_config():
    """Entries of `scontrol show config` by name; none where there is no Slurm."""
    try:
        said = subprocess.run(["scontrol", "show", "config"], capture_output=True, text=True)
    except OSError:
        return {}
    pairs = (line.split("=", 1) for line in said.stdout.splitlines() if "=" in line)
    return {name.strip(): value.strip() for name, value in pairs}


def find_slurm_problem(status_command, settings):
    """Why "sacct" or "squeue" would never tell Snakemake that a job has ended, or None."""
    if not settings:
        return "Slurm's scontrol does not answer here; start Snakemake where sbatch works."
    if settings.get("AccountingStorageType") == "accounting_storage/slurmdbd":
        return None
    if status_command != "squeue":
        return (
            "this Slurm cluster keeps no accounts, so that sacct knows of no job and Snakemake"
            " would wait for ever; add --slurm-status-command squeue."
        )
    remembered = settings.get("MinJobAge", "").split(" ")[0]
    if remembered.isdigit() and int(remembered) < REMEMBERED_S:
        return (
            f"this Slurm cluster keeps no accounts and forgets jobs {remembered} s after their end"
            " (MinJobAge), before Snakemake may have asked for them; ask your administrator for"
            f" {REMEMBERED_S} s or more."
        )
    return None


if __name__ == "__main__":
    problems = find_problems(".")
    if problems:
        sys.exit("\n".join("drapeline preflight: " + problem for problem in problems))
