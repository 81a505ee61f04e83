# Held-out samples whose scans all models are fitted to.
SCANNED_SAMPLES = [
    sample
    for sample, planned in SAMPLES.items()
    if planned.split == EVALUATED_SPLITS[0]
]
# Those of the learning group: shard and sample.
SCANNED_LEARNING = some_held_out(
    LEARNING, split=EVALUATED_SPLITS[0], most=config["scans"]["learning"]
)
SCANS = expand(f"{RESULTS}/scans/{{sample}}.npz", sample=SCANNED_SAMPLES)
if SCANNED_LEARNING:
    SCANS += [f"{RESULTS}/scans/learning.npz"]
SCANNED_SHARDS = [
    f"{LEARNED}/samples/{shard}"
    for shard in dict.fromkeys(shard for shard, _ in SCANNED_LEARNING)
]
SCANNED_SHARD_FOLDERS = [
    f"{LEARNED}/samples/{shard}/{sample}" for shard, sample in SCANNED_LEARNING
]
SCANNED = expand(f"{RESULTS}/samples/{{sample}}", sample=SCANNED_SAMPLES)
