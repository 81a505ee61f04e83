from drapeline.experiment.checks import planned_sequences, require_sequences
from drapeline.models.garment4d.variants import posed_variants
from drapeline.outfits.garment_types import TEMPLATE_TYPES

G4D = f"{RESULTS}/garment4d"
# Shards of static outfits that the networks learn from besides simulated samples.
SKINNED = list(STATIC)[: config["garment4d"]["skinned"]["shards"]]
# Samples that wear a type which the networks learn.
TEMPLATE_WEARERS = [
    sample
    for sample, planned in SAMPLES.items()
    if set(planned.outfit_type.split("+")) & set(TEMPLATE_TYPES)
]
TEMPLATES = {garment: f"{G4D}/{garment}/template.npz" for garment in TEMPLATE_TYPES}
TEMPLATE_FITS = [
    *expand(f"{G4D}/fits/static/{{shard}}", shard=SKINNED),
    *expand(f"{G4D}/fits/samples/{{sample}}", sample=TEMPLATE_WEARERS),
]
PROTOCOL = config["garment4d"]["protocol"]
# Sequences of each type, sampled as the config says.
SEQUENCES = {garment: f"{G4D}/{garment}/data_{PROTOCOL}" for garment in TEMPLATE_TYPES}
# Whether networks ask where on the known body points are.
BODY_RELATIVE_POINTS = config["garment4d"]["canonical"]["network"][
    "body_relative_points"
]
POSED_VARIANTS = posed_variants(config["garment4d"]["posed"])
# Which trained models of the posed stage each evaluation holds.
POSED_MODELS = {"default": ["posed"], "ablations": list(POSED_VARIANTS)}
METRIC_TABLES["metrics"] += [
    f"garment4d_{garment}_default" for garment in TEMPLATE_TYPES
]
METRIC_TABLES["metrics_garment4d_ablations"] = [
    f"garment4d_{garment}_ablations" for garment in TEMPLATE_TYPES
]


def own_template(wildcards):
    """The user's own OBJ that garments of this type are registered to."""
    own = config["garment4d"]["template"]["files"].get(wildcards.garment)
    return {"own": own} if own else {}


def cloud_settings(wildcards):
    """How point clouds are taken; static outfits in motion follow the config's protocol."""
    return {
        "protocol": wildcards.get("protocol", PROTOCOL),
        **config["garment4d"]["clouds"],
        "seed": config["seed"],
    }


def garment_sequences(wildcards):
    """Clouds of one protocol; those of static outfits follow the config's."""
    shards = SKINNED if wildcards.protocol == PROTOCOL else []
    return {
        "samples": [f"{RESULTS}/samples/{sample}" for sample in TEMPLATE_WEARERS],
        "clouds": [
            f"{G4D}/clouds_{wildcards.protocol}/{sample}" for sample in TEMPLATE_WEARERS
        ],
        "skinned": [f"{G4D}/skinned/{shard}" for shard in shards],
        "shards": [f"{RESULTS}/static/outfits/{shard}.npz" for shard in shards],
    }


def stage_sequences(stage=None):
    """Input function: sequences of a type, after a check that the plan has enough for a stage.

    Without a stage it is the one that the wildcard `posed` names.
    """

    def checked(wildcards):
        name = stage or posed_stage(wildcards)
        skinned = config["garment4d"]["skinned"]
        training = config["garment4d"][name]["training"]
        require_sequences(
            wildcards.garment,
            planned_sequences(
                wildcards.garment,
                SAMPLES.values(),
                [plan for shard in SKINNED for plan in STATIC[shard]],
                frames=skinned["frames"],
                step=skinned["step"],
            ),
            stage=name,
            sources=training["sources"],
            window=training["frames"],
        )
        return SEQUENCES[wildcards.garment]

    return checked


def posed_stage(wildcards):
    """The stage that a posed model is a variant of: the posed one, or its baseline."""
    return "mgn" if wildcards.posed == "mgn" else "posed"


def stage_settings(stage):
    """Settings of a network of Garment4D, by group."""
    own, posed = config["garment4d"][stage], config["garment4d"]["posed"]
    settings = {
        "network": own["network"],
        "loss": own.get("loss", posed["loss"]),
        "training": {**own["training"], "seed": config["seed"]},
    }
    if stage == "posed":
        settings["skinning"] = config["garment4d"]["skinning"]
    if stage == "canonical":
        points = config["garment4d"]["clouds"]["points"]
        settings["network"] = {**own["network"], "points": points}
    return settings


def posed_settings(wildcards):
    return stage_settings(posed_stage(wildcards))


def posed_variants_of(wildcards):
    """Variants of the posed stage that an evaluation holds."""
    return POSED_MODELS[wildcards.models]


def posed_models(wildcards):
    """Trained models of the posed stage that an evaluation holds."""
    return [
        f"{G4D}/{wildcards.garment}/{variant}"
        for variant in posed_variants_of(wildcards)
    ]


def evaluated_sequences(wildcards):
    """Sequences of a type; for the ablations with points as in the released code too."""
    sequences = {"data": SEQUENCES[wildcards.garment]}
    if wildcards.models == "ablations":
        sequences["vertex_sampled"] = f"{G4D}/{wildcards.garment}/data_vertices"
    return sequences


def evaluation_settings(wildcards):
    """Figures 8 to 10 are part of the ablations alone."""
    settings = {**config["garment4d"]["evaluation"], "seed": config["seed"]}
    if wildcards.models == "default":
        settings |= dict.fromkeys(("neighbours", "missing", "accuracy"), [])
    return settings


wildcard_constraints:
    protocol="surface|vertices",
    garment="|".join(TEMPLATE_TYPES),
    canonical="canonical|pointnet",
    posed="|".join([*POSED_VARIANTS, "mgn"]),
    models="|".join(POSED_MODELS),


rule make_garment_template:
    input:
        unpack(own_template),
        **DRESS_FORMS,
    output:
        f"{G4D}/{{garment}}/template.npz",
    log:
        f"{LOGS}/make_garment_template/{{garment}}.log",
    benchmark:
        f"{BENCHMARKS}/make_garment_template/{{garment}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        edge_length_m=lookup(dpath="garment4d/template/edge_length_m", within=config),
        code=source_hash("make_garment_template"),
    script:
        "../../scripts/make_garment_template.py"


rule fit_static_templates:
    input:
        **TEMPLATES,
        outfits=f"{RESULTS}/static/outfits/{{shard}}.npz",
        parameters=f"{RESULTS}/static/outfits/{{shard}}.json",
    output:
        directory(f"{G4D}/fits/static/{{shard}}"),
    log:
        f"{LOGS}/fit_static_templates/{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/fit_static_templates/{{shard}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=60,
    params:
        settings=lookup(dpath="garment4d/registration", within=config),
        code=source_hash("fit_static_templates"),
    script:
        "../../scripts/fit_static_templates.py"


rule fit_sample_templates:
    input:
        **TEMPLATES,
        sample=f"{RESULTS}/samples/{{sample}}",
    output:
        directory(f"{G4D}/fits/samples/{{sample}}"),
    log:
        f"{LOGS}/fit_sample_templates/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/fit_sample_templates/{{sample}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        settings=lookup(dpath="garment4d/registration", within=config),
        code=source_hash("fit_sample_templates"),
    script:
        "../../scripts/fit_sample_templates.py"


rule sample_clouds:
    input:
        f"{RESULTS}/samples/{{sample}}",
    output:
        directory(f"{G4D}/clouds_{{protocol}}/{{sample}}"),
    log:
        f"{LOGS}/sample_clouds_{{protocol}}/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/sample_clouds_{{protocol}}/{{sample}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        settings=cloud_settings,
        code=source_hash("sample_clouds"),
    script:
        "../../scripts/sample_clouds.py"


rule skin_static:
    input:
        **WHOLE_BODIES,
        outfits=f"{RESULTS}/static/outfits/{{shard}}.npz",
        parameters=f"{RESULTS}/static/outfits/{{shard}}.json",
        samples=per_sample(f"{RESULTS}/samples/{{sample}}"),
    output:
        directory(f"{G4D}/skinned/{{shard}}"),
    log:
        f"{LOGS}/skin_static/{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/skin_static/{{shard}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        frames=lookup(dpath="garment4d/skinned/frames", within=config),
        step=lookup(dpath="garment4d/skinned/step", within=config),
        clouds=cloud_settings,
        code=source_hash("skin_static"),
    script:
        "../../scripts/skin_static.py"


rule collect_garment4d:
    input:
        unpack(garment_sequences),
        **(WHOLE_BODIES if BODY_RELATIVE_POINTS else {}),
        template=f"{G4D}/{{garment}}/template.npz",
        fits=TEMPLATE_FITS,
    output:
        directory(f"{G4D}/{{garment}}/data_{{protocol}}"),
    log:
        f"{LOGS}/collect_garment4d/{{garment}}_{{protocol}}.log",
    benchmark:
        f"{BENCHMARKS}/collect_garment4d/{{garment}}_{{protocol}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=240,
    params:
        components=lookup(dpath="garment4d/components", within=config),
        body_relative_points=BODY_RELATIVE_POINTS,
        code=source_hash("collect_garment4d"),
    script:
        "../../scripts/collect_garment4d.py"


rule train_garment4d_canonical:
    input:
        **WHOLE_BODIES,
        data=stage_sequences("canonical"),
    output:
        directory(f"{G4D}/{{garment}}/{{canonical}}"),
    log:
        f"{LOGS}/train_garment4d_canonical/{{garment}}_{{canonical}}.log",
    benchmark:
        f"{BENCHMARKS}/train_garment4d_canonical/{{garment}}_{{canonical}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=3000,
        runtime=1440,
    params:
        settings=stage_settings("canonical"),
        body_points=lookup(dpath="garment4d/body_points", within=config),
        trainer=lookup(dpath="garment4d/trainer", within=config),
        progress=in_progress("canonical"),
        code=source_hash("train_garment4d_canonical"),
    script:
        "../../scripts/train_garment4d_canonical.py"


rule train_garment4d_posed:
    input:
        **WHOLE_BODIES,
        data=stage_sequences(),
        canonical=f"{G4D}/{{garment}}/canonical",
    output:
        directory(f"{G4D}/{{garment}}/{{posed}}"),
    log:
        f"{LOGS}/train_garment4d_posed/{{garment}}_{{posed}}.log",
    benchmark:
        f"{BENCHMARKS}/train_garment4d_posed/{{garment}}_{{posed}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=3000,
        runtime=1440,
    params:
        settings=posed_settings,
        body_points=lookup(dpath="garment4d/body_points", within=config),
        trainer=lookup(dpath="garment4d/trainer", within=config),
        progress=in_progress("posed"),
        code=source_hash("train_garment4d_posed"),
    script:
        "../../scripts/train_garment4d_posed.py"


rule evaluate_garment4d:
    input:
        unpack(evaluated_sequences),
        **WHOLE_BODIES,
        canonical=f"{G4D}/{{garment}}/canonical",
        pointnet=f"{G4D}/{{garment}}/pointnet",
        mgn=f"{G4D}/{{garment}}/mgn",
        posed=posed_models,
    output:
        metrics=f"{RESULTS}/metrics/garment4d_{{garment}}_{{models}}.tsv",
        pictures=directory(f"{G4D}/{{garment}}/reconstructions_{{models}}"),
    log:
        f"{LOGS}/evaluate_garment4d/{{garment}}_{{models}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_garment4d/{{garment}}_{{models}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=3000,
        runtime=240,
    params:
        posed=posed_variants_of,
        splits=EVALUATED_SPLITS,
        settings=evaluation_settings,
        refine=lookup(dpath="garment4d/refine", within=config),
        body_points=lookup(dpath="garment4d/body_points", within=config),
        code=source_hash("evaluate_garment4d"),
    script:
        "../../scripts/evaluate_garment4d.py"


include: "garment4d_figures.smk"
include: "garment4d_reconstruct.smk"
