DEFAULT_TARGETS += per_sample(f"{RESULTS}/gallery/{{sample}}.png")
DEFAULT_TARGETS += per_sample(f"{RESULTS}/gallery/{{sample}}_moving.png")
SAMPLE_STEPS += [
    SampleStep(
        "render_gallery", f"{RESULTS}/gallery/{{sample}}{part}.png", set(SAMPLES), False
    )
    for part in ("", "_moving")
]


rule render_gallery:
    input:
        f"{RESULTS}/samples/{{sample}}",
    output:
        # A report shows PNG in the page, animated ones too, but offers WebP and GIF as downloads.
        still=report(
            f"{RESULTS}/gallery/{{sample}}.png",
            caption="../report/gallery.rst",
            category="Gallery",
            labels=gallery_labels("still"),
        ),
        moving=report(
            f"{RESULTS}/gallery/{{sample}}_moving.png",
            caption="../report/gallery.rst",
            category="Gallery",
            labels=gallery_labels("moving"),
        ),
    log:
        f"{LOGS}/render_gallery/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/render_gallery/{{sample}}.tsv"
    wildcard_constraints:
        sample=SINGLE_SAMPLE,
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("render_gallery"),
    script:
        "../../scripts/render_gallery.py"


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
        samples=r"\d+(-\d+)*",
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("render_people"),
    script:
        "../../scripts/render_people.py"


rule render_modalities:
    input:
        f"{RESULTS}/samples/{{sample}}",
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
        runtime=30,
    params:
        frames=lookup(dpath="renders/modality_frames", within=config),
        code=source_hash("render_modalities"),
    script:
        "../../scripts/render_modalities.py"
