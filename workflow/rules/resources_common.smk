# What jobs ask a cluster for. Seconds and megabytes are those of the default experiment's jobs on one
# core, which these factors carry over to other sizes.
FRAMES = config["motions"]["frames"] / 60
CLOTH = cloth_factor(config["outfits"]["edge_length_m"])
# A simulation's memory is that of the solver and of the body as well.
CLOTH_MEMORY = 1 + (CLOTH * FRAMES - 1) / 8 if CLOTH * FRAMES > 1 else 1
STATIC_CLOTH = cloth_factor(config["static"]["edge_length_m"])
STATIC_SHARD = config["static"]["shard_size"] / 100 * STATIC_CLOTH
STATIC_SIZE = config["static"]["count"] / 400
MOVING_FRAMES = (
    sum(plan.stop - plan.start for plan in SAMPLES.values())
    + sum(map(len, LEARNING.values())) * config["learning"]["frames"]
)
MOVING_SIZE = MOVING_FRAMES / (176 * 60)
LEARNING_SHARD = (
    config["learning"]["shard_size"]
    / 20
    * (config["learning"]["frames"] / 60)
    * cloth_factor(config["learning"]["edge_length_m"])
)
# A sample of 60 frames in two tries; solvers that are not named are taken for slow.
QUICK_SOLVERS_S, SOLVER_S = {"xpbd": 10}, 80
SIMULATION_S = (
    QUICK_SOLVERS_S.get(config["simulation"]["solver"], SOLVER_S)
    * (config["simulation"]["settings"]["attempts"] / 2)
    * FRAMES
    * CLOTH
)
LEARNING_S = (
    20
    * QUICK_SOLVERS_S.get(config["learning"]["solver"], SOLVER_S)
    * (config["learning"]["attempts"] / 2)
    * LEARNING_SHARD
)
# All steps of a sample that a shard makes; each starts Python anew.
SAMPLE_S = SIMULATION_S + 9 * FRAMES + 8 * CLOTH + 40


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


def gpus(model):
    """GPUs that a training asks for: none unless the config insists on them."""
    trainer = config[model]["trainer"]
    if trainer["accelerator"] != "gpu":
        return 0
    return trainer["devices"] if trainer["devices"] not in ("auto", -1) else 1


# Solvers that can use a GPU.
GPU_SOLVERS = {"xpbd"}


def simulation_gpus(solver):
    """GPUs that a simulation asks for: none unless its solver can use one and the config insists."""
    return int(solver in GPU_SOLVERS and config["simulation"]["accelerator"] == "gpu")


def vae_seconds(model):
    """Seconds of a training of the svae or the dvae."""
    chosen = config["gcvae"][model]
    garments = (
        config["static"]["count"]
        if model == "svae"
        else MOVING_FRAMES / chosen["frame_step"]
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
    return 0.004 * training["epochs"] * training["visits"] * config["static"]["count"]
