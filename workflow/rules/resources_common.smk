# What jobs ask a cluster for. Seconds and megabytes are those of the default experiment's jobs on one
# core, which these factors carry over to other sizes.
from drapeline.experiment.resources import asked_mb, asked_minutes, cloth_factor

STATIC_SIZE = len(RESTING_PLANS) / 400
MOVING_FRAMES = sum(plan.frames for plan in MOVING_PLANS.values())
MOVING_SIZE = MOVING_FRAMES / (176 * 60)


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


def gpus(model):
    """GPUs that a training asks for: none unless the config insists on them."""
    trainer = config[model]["trainer"]
    if trainer["accelerator"] != "gpu":
        return 0
    return trainer["devices"] if trainer["devices"] not in ("auto", -1) else 1


def vae_seconds(model):
    """Seconds of a training of the svae or the dvae."""
    chosen = config["gcvae"][model]
    garments = (
        len(RESTING_PLANS) if model == "svae" else MOVING_FRAMES / chosen["frame_step"]
    )
    width = chosen["network"]["widths"][0] / 8
    return 0.025 * chosen["training"]["epochs"] * garments * width


def garment4d_seconds(stage):
    """Seconds of a training of one type's canonical or posed stage."""
    chosen = config["garment4d"][stage]
    points = config["garment4d"]["clouds"]["points"] / 1024
    rate_s = {"canonical": 0.0046, "posed": 0.033}[stage]
    frames = chosen["training"]["frames"] / chosen["training"]["stride"]
    return rate_s * chosen["training"]["epochs"] * MOVING_FRAMES * frames * points


def batch_mb(model, network):
    """Megabytes of a training: its batch, beside the libraries."""
    chosen = config[model][network]
    batch = chosen["training"]["batch"]
    if model == "gcvae":
        return 500 + 60 * batch * chosen["network"]["widths"][0] / 8
    points = config["garment4d"]["clouds"]["points"] / 1024
    # Linear as far as it was measured; what is larger belongs on a GPU.
    return min(400 + 160 * batch * chosen["training"]["frames"] * points, 40_000)


def smplicit_seconds():
    """Seconds of a training of one of SMPLicit's models."""
    training = config["smplicit"]["training"]
    return 0.004 * training["epochs"] * training["visits"] * len(RESTING_PLANS)
