# What jobs ask a cluster for. Seconds and megabytes are those of the default experiment's jobs on one
# core, which these factors carry over to other sizes.
from drapeline.experiment.resources import asked_mb, asked_minutes, cloth_factor


def minutes(seconds):
    """Resources function: minutes to ask for where so many seconds are expected."""

    def asked(wildcards, attempt):
        return asked_minutes(seconds, attempt)

    return asked


def memory(megabytes):
    """Resources function: megabytes to ask for where so many are expected."""

    def asked(wildcards, attempt):
        return asked_mb(megabytes, attempt)

    return asked


def cloth_of(wildcards):
    """Vertices of a group's garments, as a multiple of those with edges of 2 cm."""
    return cloth_factor(GROUPS[wildcards.group].outfits["edge_length_m"])


def shard_minutes(seconds):
    """Resources function: minutes for a shard of samples that take so many seconds each.

    Those of 60 frames, in motion, with edges of 2 cm.
    """

    def asked(wildcards, attempt):
        frames = sum(plan.frames / 60 or 1 for plan in plans_of(wildcards))
        return asked_minutes(seconds * frames * cloth_of(wildcards), attempt)

    return asked


def simulation_minutes(wildcards, attempt):
    """Resources function: minutes for a shard to be simulated, or simulated again, in one try."""
    return shard_minutes(solver_of(wildcards).sample_s / 2)(wildcards, attempt)


def retrial_minutes(wildcards, attempt):
    """Resources function: minutes for a shard to be written, after more tries at all of it."""
    further = GROUPS[wildcards.group].simulation["attempts"] - 1
    seconds = 2 + further * 1.5 * solver_of(wildcards).sample_s / 2
    return shard_minutes(seconds)(wildcards, attempt)


def simulation_mb(wildcards, attempt):
    """Resources function: megabytes of a simulation, its solver and its body."""
    frames = max(plan.frames for plan in plans_of(wildcards)) / 60
    size = max(cloth_of(wildcards) * frames, 1)
    return asked_mb(550 * (1 + (size - 1) / 8), attempt)


def shard_memory(fixed, each):
    """Resources function: megabytes of a shard, of which each outfit takes some."""

    def asked(wildcards, attempt):
        size = len(plans_of(wildcards)) * cloth_of(wildcards)
        return asked_mb(fixed + each * size, attempt)

    return asked


def simulation_gpus(wildcards):
    """GPUs that a simulation asks for: none unless its solver can use one and the config insists."""
    wanted = config["simulation"]["accelerator"] == "gpu"
    return int(wanted and solver_of(wildcards).uses_gpu)


def hanging_gpus(wildcards):
    """GPUs for outfits at rest to hang."""
    wanted = config["simulation"]["accelerator"] == "gpu"
    return int(wanted and QUICK_SOLVER.uses_gpu and hangs(wildcards))


def outfit_minutes(wildcards, attempt):
    """Resources function: minutes for the outfits of a shard, which may hang."""
    frames = GROUPS[wildcards.group].outfits["hang_frames"] if hangs(wildcards) else 0
    seconds = (0.4 + 0.1 * frames) * len(plans_of(wildcards)) * cloth_of(wildcards)
    return asked_minutes(seconds, attempt)
