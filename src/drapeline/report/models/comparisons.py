"""Pages that compare all models: the same garments through their codes, and the same scans."""

from dataclasses import replace
from pathlib import Path

from drapeline.metrics.properties import CLASSES, COMMON
from drapeline.metrics.registry import variants
from drapeline.metrics.shared import REPRESENTATION, SCAN
from drapeline.metrics.table import ALL
from drapeline.outfits.garment_types import GARMENT4D_TYPES
from drapeline.report.html import number
from drapeline.report.tables import MetricTable, Section, read_test_metrics, write_sections
from drapeline.schema import Table

_WAYS = {
    "surface_to_true_mm": "From {} to the true garment (mm)",
    "true_to_surface_mm": "From the true garment to {} (mm)",
}
_BODIES = tuple(name for name in variants(SCAN) if name.startswith("scan_body_"))
# Table 2 of SMPLicit: mean distances in mm within the garments of real scans.
_PRINTED = {
    "CAPE": (0.87, 1.35, 1.15, 1.09),
    "TailorNet": (0.32, 0.41, None, 0.48),
    "SMPLicit": (0.46, 0.52, 0.78, 0.58),
}


def write_representations(path: str | Path, metrics: str | Path) -> None:
    """Write the page of codes.

    Args:
        metrics: table of metrics with the rows of `compare_representations`.

    Raises:
        InputError: the table is missing or unusable.
    """
    measured = read_test_metrics(metrics, [REPRESENTATION])
    names = measured_variants(measured, REPRESENTATION)
    coded = set(measured.loc[measured["metric"] == "code_numbers", "variant"])
    codes = MetricTable(
        sorted(names, key=lambda name: name not in coded),
        ["code_numbers"],
        GARMENT4D_TYPES,
        across="garment",
        count="",
    )
    distances = replace(
        codes, garments=(*GARMENT4D_TYPES, ALL), digits=dict.fromkeys(_WAYS, 2), count="Garments"
    )
    write_sections(
        path,
        "The same garments through all codes",
        [
            "All garments of these types in the test split of static outfits, which no model has"
            " seen. Mean distances over the area of the surfaces in mm, with 95 % intervals over"
            " outfits. No code can recover what registration loses, which the rows without a code"
            " show."
        ],
        [
            *(
                Section(title.format("the reconstruction"), replace(distances, metrics=[metric]))
                for metric, title in _WAYS.items()
            ),
            Section(
                "Numbers of the code",
                codes,
                below="The body's shape and other inputs of the decoder do not count.",
            ),
        ],
        measured,
    )


def write_scans_page(path: str | Path, metrics: str | Path) -> None:
    """Write the page of fits to scans.

    Args:
        metrics: table of metrics with the rows of `compare_frames`.

    Raises:
        InputError: the table is missing or unusable.
    """
    measured = read_test_metrics(metrics, [SCAN])
    fits = [name for name in measured_variants(measured, SCAN) if name not in _BODIES]
    # Rows with other numbers of garments are not about the same ones, so none is the best.
    distances = MetricTable(
        fits, list(_WAYS), (*CLASSES, COMMON, ALL), across="garment", best=False
    )
    write_sections(
        path,
        "All models fitted to the same scans",
        [
            "Segmented scans of simulated samples of the test split, all of the dataset's and"
            " some of those that models learn from (the fast solver's), with noise. The body is"
            " estimated wrongly on purpose and fitted to each scan first; all models but the"
            " start get the same points and the same fitted body, and wear their garments in"
            " the same way, but for the rows of SMPLicit that hang (simulated on the person,"
            " who stands still), which are to be compared with one another, and its other rows"
            " with the other models. Mean distances over the area of the surfaces in mm, with"
            " 95 % intervals over clips. Models are compared on the garments that they know,"
            " so rows with other"
            f" numbers of garments are not about the same garments; the column"
            f" '{COMMON.capitalize()}' has the means over those that all models know."
        ],
        [
            *(
                Section(
                    title.format("the fitted garment"),
                    replace(distances, metrics=[metric]),
                    by_source=True,
                )
                for metric, title in _WAYS.items()
            ),
            Section(
                "Bodies: mean distance of vertices",
                MetricTable(_BODIES, ["vertex_error_mm"], count="Scans"),
            ),
            Section(
                "The paper's own figures",
                _printed_scans(),
                "Table 2 of SMPLicit: distances within the segmented garments of real scans of the"
                " Sizer dataset in mm. Those scans cannot be had here; the figures cannot be"
                " compared with those above.",
            ),
        ],
        measured,
    )


def measured_variants(measured: Table, model: str) -> list[str]:
    """All variants of a model that were measured: declared ones first, in their order."""
    found = list(dict.fromkeys(measured.loc[measured["model"] == model, "variant"]))
    declared = list(variants(model))
    return [name for name in declared if name in found] + [
        name for name in found if name not in declared
    ]


def _printed_scans() -> list[dict[str, str]]:
    return [
        {"Method": method}
        | {
            name.capitalize(): number("-" if error is None else f"{error:g}", "theirs")
            for name, error in zip(CLASSES, errors, strict=False)
        }
        for method, errors in _PRINTED.items()
    ]
