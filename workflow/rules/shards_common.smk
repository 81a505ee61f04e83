# Settings of all steps from a body to what models read of a sample.
SHARD_SETTINGS = {
    **{
        key: config[key]
        for key in ("seed", "body", "outfits", "simulation", "registration")
    },
    "renders": config["renders"],
    "scans": {key: config["scans"][key] for key in ("samples", "body")},
    "lock_feet": config["motions"]["lock_feet"],
    "garment4d": {
        key: config["garment4d"][key]
        for key in ("garments", "template", "registration", "clouds", "protocol")
    },
}
# The scripts of these steps, and of what they need of all samples.
SHARD_CODE = [
    source_hash("simulate_outfit", SOLVER_MODULE),
    *[
        source_hash(script)
        for script in (
            *("import_motion", "animate_body", "make_outfit", "build_templates"),
            *("build_super_body", "make_garment_template"),
            *(step.script for step in SAMPLE_STEPS),
        )
    ],
]


def shard_motions(members):
    """The clips of the samples of a shard."""
    clips = dict.fromkeys(SAMPLES[sample].sequence for sample in members)
    return [MOTIONS[clip] for clip in clips]


def shard_inputs(members):
    """What the samples of a shard are made from: all that no step makes."""
    return [
        *WHOLE_BODIES.values(),
        *(file for clip in shard_motions(members) for file in clip.files.values()),
        *OWN_GARMENT_FILES,
        *config["garment4d"]["template"]["files"].values(),
    ]


def shard_outputs(members):
    """What is made of the samples of a shard."""
    return [
        (
            directory(step.output.format(sample=sample))
            if step.is_folder
            else step.output.format(sample=sample)
        )
        for step in SAMPLE_STEPS
        for sample in members
        if sample in step.samples
    ]
