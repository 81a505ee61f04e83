from snakemake.utils import min_version

min_version("9.27")


configfile: "config.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/bodies.smk"
include: "workflow/rules/outfits.smk"
include: "workflow/rules/simulation.smk"
include: "workflow/rules/dataset.smk"
include: "workflow/rules/static.smk"
include: "workflow/rules/registration.smk"
include: "workflow/rules/gcvae.smk"
include: "workflow/rules/evaluation.smk"
include: "workflow/rules/garment4d.smk"
include: "workflow/rules/garment4d_figures.smk"
include: "workflow/rules/reconstruct.smk"
include: "workflow/rules/renders.smk"
include: "workflow/rules/report.smk"


SOURCES.remember()


report: "workflow/report/workflow.rst"


rule all:
    default_target: True
    input:
        f"{RESULTS}/dataset",
        gallery_files(),
        REGISTRATION_FILES,
        GCVAE_FILES,
        GARMENT4D_FILES,
        REPORT_FILES,
