GALLERY_PICTURES = per_shard(f"{RESULTS}/gallery/{{group}}/{{shard}}", PUBLISHED)
DEFAULT_TARGETS += GALLERY_PICTURES
DEFAULT_TARGETS += [
    f"{RESULTS}/report/{group.name}.png" for group in MOVING if not group.published
]


rule render_gallery:
    input:
        SAMPLE,
    output:
        # Moving pictures would be half of a report; its front page has small ones of all samples.
        report(
            directory(f"{RESULTS}/gallery/{{group}}/{{shard}}"),
            patterns=[r"{sample,\w*\d}.png"],
            caption="../report/gallery.rst",
            category="Gallery",
            labels=gallery_labels,
        ),
    log:
        f"{LOGS}/render_gallery/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/render_gallery/{{group}}_{{shard}}.tsv"
    priority: PICTURES_FIRST
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=shard_minutes(6),
    params:
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("render_gallery"),
    script:
        "../../scripts/render_gallery.py"


rule plot_group:
    input:
        group_samples,
    output:
        report(
            f"{RESULTS}/report/{{group}}.png",
            caption="../report/group.rst",
            category="Dataset",
            labels={"shows": "samples of the group {group}"},
        ),
    log:
        f"{LOGS}/plot_group/{{group}}.log",
    benchmark:
        f"{BENCHMARKS}/plot_group/{{group}}.tsv"
    wildcard_constraints:
        group=group_names(MOVING),
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=20,
    params:
        most=24,
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_group"),
    script:
        "../../scripts/plot_group.py"


rule render_people:
    input:
        samples_side_by_side,
    output:
        f"{RESULTS}/people/{{samples}}.webp",
    log:
        f"{LOGS}/render_people/{{samples}}.log",
    benchmark:
        f"{BENCHMARKS}/render_people/{{samples}}.tsv"
    wildcard_constraints:
        samples=r"\w+(-\w+)*",
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        samples=ids_side_by_side,
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("render_people"),
    script:
        "../../scripts/render_people.py"


rule render_modalities:
    input:
        **WHOLE_BODIES,
        shard=sample_shard,
    output:
        directory(f"{RESULTS}/modalities/{{sample}}"),
    log:
        f"{LOGS}/render_modalities/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/render_modalities/{{sample}}.tsv"
    conda:
        "../../envs/blender.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=minutes(
            20
            * len(config["renders"]["modality_frames"])
            * config["renders"]["cameras"]
        ),
    params:
        frames=lookup(dpath="renders/modality_frames", within=config),
        cameras=lookup(dpath="renders/cameras", within=config),
        code=source_hash("render_modalities"),
    script:
        "../../scripts/render_modalities.py"
