rule regress_picture:
    input:
        unpack(own_picture),
        **WHOLE_BODIES,
        network=f"{RESULTS}/gcvae/pictures",
        model=f"{RESULTS}/gcvae/{config['gcvae']['sampling']['variant']}",
    output:
        folder=directory(f"{RESULTS}/gcvae/images/{{picture}}"),
        shown=f"{RESULTS}/gcvae/images/{{picture}}_shown.npz",
    log:
        f"{LOGS}/regress_picture/{{picture}}.log",
    benchmark:
        f"{BENCHMARKS}/regress_picture/{{picture}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        **FILES.hanging,
        least_px=lookup(dpath="smplicit/fit_images/least_px", within=config),
        hang_frames=lookup(dpath="gcvae/sampling/hang_frames", within=config),
        code=source_hash("regress_picture", QUICK_SOLVER.code),
    script:
        "../../scripts/regress_picture.py"


rule garment_from_picture:
    # The garments in the pictures that the config names, from the network's codes.
    input:
        pictures_by("gcvae"),
