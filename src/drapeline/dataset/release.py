"""A dataset as it is published: with an index, a licence, checksums and metadata for machines.

The folder can be uploaded as it is, such as to the Hugging Face Hub or to Zenodo. `croissant.json`
describes it in Croissant 1.0 (MLCommons), which search engines and loaders of datasets read.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drapeline.dataset.card import released_card
from drapeline.dataset.collect import accepted_records
from drapeline.dataset.record import SPLITS
from drapeline.dataset.tables import SAMPLES
from drapeline.errors import InputError
from drapeline.manifest import MANIFEST, damages, read_manifest, sum_file, write_manifest
from drapeline.schema import Table, read_table, typed, write_parquet
from drapeline.storage import atomic_folder, copy_file, copy_folder, read_text

INDEX, SUMS, CROISSANT = "samples.parquet", "SHA256SUMS", "croissant.json"
_FREE_BODY = "drapeline-anny-"  # names of the bodies that come with drapeline begin so
_LOADER = '''\
"""Clothed people in motion, frame by frame; needs drapeline (`pip install drapeline`)."""

import drapeline

for sample in drapeline.open_dataset(".", "train"):
    body, cloth = sample.body_vertices(0, 10), sample.vertices(sample.garments[0], 0, 10)
    print(sample.id, sample.garments, cloth.shape, body.shape)  # (10, V, 3) metres, Z up
'''
_LICENCE = """\
This dataset is licensed under the Creative Commons Attribution 4.0 International License.

To view a copy of this license, visit https://creativecommons.org/licenses/by/4.0/ or send a letter
to Creative Commons, PO Box 1866, Mountain View, CA 94042, USA.
"""
_TYPES = {"i": "sc:Integer", "f": "sc:Float"}


def release_dataset(
    dataset: str | Path, output: str | Path, *, name: str, creator: str, version: str
) -> None:
    """Copy a collected dataset, ready to be published.

    Args:
        dataset: as `collect_dataset` left it.
        output: folder; replaced as a whole.
        name: of the dataset, for machines.
        creator: who publishes it.
        version: of it.

    Raises:
        InputError: a file is damaged, or samples have bodies that may not be passed on.
    """
    dataset = Path(dataset)
    for damage in damages(dataset, MANIFEST, sums=True):
        raise damage
    models = {record.meta["body"]["model"] for record in accepted_records(dataset)}
    others = sorted(model for model in models if not model.startswith(_FREE_BODY))
    if others:
        raise InputError(
            f"{dataset}: has bodies of {', '.join(others)}, whose licence does not let you pass"
            " them on; expected those that come with drapeline"
        )
    samples = typed(read_table(dataset / "samples.tsv", SAMPLES), SAMPLES)
    with atomic_folder(output) as scratch:
        for entry in sorted(dataset.iterdir()):
            if not entry.name.startswith("."):  # as Snakemake's marks
                copy = copy_folder if entry.is_dir() else copy_file
                copy(entry, scratch / entry.name)
        card = read_text(dataset / "README.md", "a dataset card")
        (scratch / "README.md").write_text(released_card(card))
        (scratch / "LICENSE").write_text(_LICENCE)
        (scratch / "load.py").write_text(_LOADER)
        write_parquet(scratch / INDEX, samples)
        about = {"name": name, "creator": creator, "version": version}
        described = describe(samples, scratch / INDEX, about)
        (scratch / CROISSANT).write_text(json.dumps(described, indent=2) + "\n")
        known = read_manifest(dataset / MANIFEST)
        known.pop("README.md")
        write_manifest(scratch, known=known)
        sums = {**read_manifest(scratch / MANIFEST), MANIFEST: sum_file(scratch / MANIFEST)}
        lines = [f"{one.sha256}  {file}\n" for file, one in sorted(sums.items())]
        (scratch / SUMS).write_text("".join(lines))


def describe(samples: Table, index: Path, about: Mapping[str, str]) -> dict[str, Any]:
    """What `croissant.json` holds: the index with its columns, and the files of samples.

    Args:
        samples: rows of the index.
        index: its file, in the folder with those of samples.
        about: `name`, `creator` and `version`.
    """
    fields = [
        {
            "@type": "cr:Field",
            "@id": f"samples/{column}",
            "name": column,
            "dataType": _TYPES.get(samples[column].dtype.kind, "sc:Text"),
            "source": {"fileObject": {"@id": INDEX}, "extract": {"column": column}},
        }
        for column in samples
    ]
    parts = {
        "rest-garments": ("*/*/*.obj", "model/obj", "Garments at rest, quads, metres."),
        "poses": ("*/*/info.mat", "application/x-matlab-data", "Poses, shapes and outfits."),
        "prints": ("*/*/*.png", "image/png", "What is printed on garments."),
        "garments-in-motion": (
            "*/*/*.pc16",
            "application/octet-stream",
            "Vertices of garments in every frame, half precision, relative to the root joint.",
        ),
        "extras": (
            "*/*/extras/*",
            "application/octet-stream",
            "Bodies, single precision, fabrics, health of every frame, and how each was made.",
        ),
    }
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": about["name"],
        "description": (
            f"{len(samples)} sequences of clothed people in motion, simulated, in the format of"
            f" CLOTH3D; splits {', '.join(SPLITS)} by clip and body."
        ),
        "creator": {"@type": "sc:Organization", "name": about["creator"]},
        "license": "https://creativecommons.org/licenses/by/4.0/",
        "version": about["version"],
        "citeAs": "Made with drapeline, after Bertiche, Madadi and Escalera: CLOTH3D, ECCV 2020.",
        "distribution": [
            {
                "@type": "cr:FileObject",
                "@id": INDEX,
                "name": INDEX,
                "contentUrl": INDEX,
                "encodingFormat": "application/x-parquet",
                "sha256": sum_file(index).sha256,
            },
            *(
                {
                    "@type": "cr:FileSet",
                    "@id": key,
                    "name": key,
                    "description": text,
                    "encodingFormat": kind,
                    "includes": pattern,
                }
                for key, (pattern, kind, text) in parts.items()
                if any(index.parent.glob(pattern))
            ),
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "samples",
                "name": "samples",
                "description": "A row for each sequence.",
                "key": {"@id": "samples/sample"},
                "field": fields,
            }
        ],
    }


# As Croissant's specification gives it.
_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
