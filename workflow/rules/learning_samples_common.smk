# The learning group: samples in shards, each a folder of CLOTH3D folders.
LEARNED = f"{RESULTS}/learning"
LEARNING_PLANS = [plan for plans in LEARNING.values() for plan in plans]
LEARNING_SAMPLES = expand(f"{LEARNED}/samples/{{shard}}", shard=LEARNING)
LEARNING_REGISTRATIONS = expand(f"{LEARNED}/registration/{{shard}}", shard=LEARNING)
if LEARNING_SAMPLES:
    DEFAULT_TARGETS += [f"{RESULTS}/report/learning.png"]
LEARNING_CLIPS = {
    name: {
        **clip.files,
        **clip.parameters(),
        "lock_feet": config["motions"]["lock_feet"],
    }
    for name, clip in LEARNING_MOTIONS.items()
}
LEARNING_MOTION_FILES = [
    file for clip in LEARNING_MOTIONS.values() for file in clip.files.values()
]
OWN_GARMENT_FILES = sorted(
    {own["path"] for worn in OWN_GARMENTS.values() for own in worn.values()}
)


def learning_plans(wildcards):
    """Params function: the plans of a shard's samples."""
    return [asdict(plan) for plan in LEARNING[wildcards.shard]]
