# Where the config asks for shards, one job makes all of some samples: it runs the rules for single
# samples, which make none here, in a folder of its own. A job for each step of each sample would be
# many more than clusters like, and than Snakemake plans in a minute.
include: "shards_common.smk"


for SHARD, MEMBERS in SAMPLE_SHARDS.items():

    rule:
        name:
            f"make_samples_{SHARD}"
        input:
            shard_inputs(MEMBERS),
        output:
            shard_outputs(MEMBERS),
        log:
            f"{LOGS}/make_samples/{SHARD}.log",
        priority: SAMPLES_FIRST
        # No benchmark: the steps have theirs.
        conda:
            SOLVER_ENVIRONMENT
        threads: 1
        resources:
            mem_mb=memory(550 * CLOTH_MEMORY),
            runtime=minutes(len(MEMBERS) * SAMPLE_S),
            gpu=simulation_gpus(config["simulation"]["solver"]),
        params:
            folder=shard_folder(SHARD),
            plans=[asdict(SAMPLES[sample]) for sample in MEMBERS],
            motions=[clip.parameters() for clip in shard_motions(MEMBERS)],
            settings=SHARD_SETTINGS,
            code=SHARD_CODE,
        script:
            "../../scripts/make_samples.py"
