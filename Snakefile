from pathlib import Path

from snakemake.utils import min_version

min_version("9.27")


# An experiment of one's own replaces the default one; what it omits takes the schema's defaults.
DEFAULT = Path("config.yaml")
if not workflow.overwrite_configfiles:

    configfile: DEFAULT if DEFAULT.is_file() else workflow.source_path(str(DEFAULT))


include: "workflow/rules/common.smk"
include: "workflow/rules/groups_common.smk"
include: "workflow/rules/resources_common.smk"
include: "workflow/rules/bodies.smk"
include: "workflow/rules/outfits.smk"
include: "workflow/rules/simulation.smk"
include: "workflow/rules/dataset.smk"
include: "workflow/rules/renders.smk"
include: "workflow/rules/registration.smk"
include: "workflow/rules/learning_data.smk"
include: "workflow/rules/scans.smk"
include: "workflow/rules/models.smk"
include: "workflow/rules/pictures.smk"
include: "workflow/rules/gcvae_pictures.smk"
include: "workflow/rules/garment4d.smk"
include: "workflow/rules/smplicit.smk"
include: "workflow/rules/evaluation.smk"
include: "workflow/rules/release.smk"
include: "workflow/rules/report.smk"


SOURCES.remember()
FRAME_COUNTS.remember()


onstart:
    check_cluster()
    remove_scraps()
    tell_left_out()
    tell_starts()


report: "workflow/report/workflow.rst"


rule all:
    default_target: True
    input:
        DEFAULT_TARGETS,


check_targets()
