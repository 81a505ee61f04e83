GALLERY_SHEETS = {
    "samples": "sampled garments",
    "prototypes": "prototypes",
    "transitions": "between prototypes",
    "axes": "principal axes of the cut",
    "bodies": "one garment on five bodies",
    "edits": "single properties edited",
}


rule make_smplicit_gallery:
    input:
        model=f"{SMPLICIT}/{{field}}",
        outfits=ALL_OUTFITS_AT_REST,
    output:
        directory(f"{SMPLICIT}/gallery/{{field}}"),
    log:
        f"{LOGS}/make_smplicit_gallery/{{field}}.log",
    benchmark:
        f"{BENCHMARKS}/make_smplicit_gallery/{{field}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=4000,
        runtime=120,
    params:
        samples=GALLERY["count"],
        meshing=lookup(dpath="smplicit/meshing", within=config),
        seed=config["seed"],
        code=source_hash("make_smplicit_gallery"),
    script:
        "../../scripts/make_smplicit_gallery.py"


rule plot_smplicit_gallery:
    input:
        **WHOLE_BODIES,
        gallery=f"{SMPLICIT}/gallery/{{field}}",
    output:
        **{
            sheet: report(
                f"{RESULTS}/report/smplicit_{{field}}_{sheet}.png",
                caption=f"../report/smplicit_{sheet}.rst",
                category="SMPLicit",
                labels={"shows": f"{title} ({{field}})"},
            )
            for sheet, title in GALLERY_SHEETS.items()
        },
    log:
        f"{LOGS}/plot_smplicit_gallery/{{field}}.log",
    benchmark:
        f"{BENCHMARKS}/plot_smplicit_gallery/{{field}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=60,
    params:
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_smplicit_gallery"),
    script:
        "../../scripts/plot_smplicit_gallery.py"


rule pose_smplicit_garment:
    input:
        model=f"{SMPLICIT}/{{field}}",
        gallery=f"{SMPLICIT}/gallery/{{field}}",
        bodies=gallery_body,
    output:
        sheet=report(
            f"{RESULTS}/report/smplicit_{{field}}_posed.png",
            caption="../report/smplicit_posed.rst",
            category="SMPLicit",
            labels={"shows": "a garment posed ({field})"},
        ),
        moving=report(
            f"{RESULTS}/report/smplicit_{{field}}_moving.png",
            caption="../report/smplicit_posed.rst",
            category="SMPLicit",
            labels={"shows": "a garment in motion ({field})"},
        ),
        scene=f"{SMPLICIT}/posed/{{field}}.glb",
    log:
        f"{LOGS}/pose_smplicit_garment/{{field}}.log",
    benchmark:
        f"{BENCHMARKS}/pose_smplicit_garment/{{field}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=60,
    params:
        sample=gallery_sample,
        frames=GALLERY["frames"],
        skinning=GALLERY["skinning"],
        push_out=GALLERY["push_out"],
        simulate=GALLERY["simulate"],
        solver=QUICK_SOLVER.code,
        edge_length_m=lookup(dpath="outfits/edge_length_m", within=config),
        simulation=lookup(dpath="simulation/settings", within=config),
        bounds=lookup(dpath="simulation/bounds", within=config),
        shown=6,
        meshing=lookup(dpath="smplicit/meshing", within=config),
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("pose_smplicit_garment", QUICK_SOLVER.code),
    script:
        "../../scripts/pose_smplicit_garment.py"


rule tabulate_smplicit_gallery:
    input:
        expand(f"{SMPLICIT}/gallery/{{field}}", field=GALLERY["models"]),
    output:
        page=report(
            f"{RESULTS}/report/smplicit_codes.html",
            caption="../report/smplicit_codes.rst",
            category="SMPLicit",
            labels={"shows": "what codes say about garments"},
        ),
        table=f"{RESULTS}/report/smplicit_correlations.tsv",
    log:
        f"{LOGS}/tabulate_smplicit_gallery.log",
    benchmark:
        f"{BENCHMARKS}/tabulate_smplicit_gallery.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        models=GALLERY["models"],
        code=source_hash("tabulate_smplicit_gallery"),
    script:
        "../../scripts/tabulate_smplicit_gallery.py"


rule smplicit_gallery:
    # Garments sampled, interpolated, edited and posed; nothing of it is part of the default.
    input:
        rules.tabulate_smplicit_gallery.output,
        expand(
            [
                *rules.plot_smplicit_gallery.output,
                *rules.pose_smplicit_garment.output,
            ],
            field=GALLERY["models"],
        ),
