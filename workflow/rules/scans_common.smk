from drapeline.experiment.learning_plan import some_held_out

# Held-out samples whose scans all models are fitted to.
SCANNED_SAMPLES = [
    sample
    for sample, planned in SAMPLES.items()
    if planned.split == EVALUATED_SPLITS[0]
]
# Those of the learning group: shard and sample.
SCANNED_LEARNING = some_held_out(
    config["seed"],
    LEARNING,
    split=EVALUATED_SPLITS[0],
    most=config["scans"]["learning"],
)
SCANNED_SHARDS = expand(
    f"{LEARNED}/samples/{{shard}}",
    shard=sorted({shard for shard, _ in SCANNED_LEARNING}),
)
SCAN_FILES = expand(f"{RESULTS}/scans/{{sample}}.npz", sample=SCANNED_SAMPLES)
if SCANNED_LEARNING:
    SCAN_FILES += [f"{RESULTS}/scans/learning.npz"]
# Inputs of the rules that fit models to scans, with the truth.
KNOWN_SCANS = {
    "scans": SCAN_FILES,
    "samples": expand(f"{RESULTS}/samples/{{sample}}", sample=SCANNED_SAMPLES),
    "learning": SCANNED_SHARDS,
}
