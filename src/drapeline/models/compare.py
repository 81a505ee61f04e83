"""The same held-out garments through the codes of all models, by the same distances."""

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.learning_data.static import StaticData
from drapeline.metrics.baselines import fit_pca
from drapeline.metrics.garment import area_distances_mm, garment_mesh
from drapeline.metrics.table import MetricRow, summary_rows
from drapeline.models.gcvae.codes import decode_codes, encode_garments
from drapeline.models.gcvae.evaluate_static import static_truth
from drapeline.models.gcvae.vae import StaticVae
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.static import StaticOutfit
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.registration.to_template.remesh_table import RemeshTable, remesh
from drapeline.rule_log import progress
from drapeline.seeding import rng_for

MODEL = "representation"
Rebuild = Callable[[int, np.ndarray], Mesh]


def compare_representations(
    data: StaticData,
    outfits: Iterable[StaticOutfit],
    models: Mapping[str, StaticVae],
    spaces: Mapping[str, GarmentSpace],
    tables: Mapping[str, Mapping[str, RemeshTable]],
    *,
    components: int,
    split: str,
    seed: int,
) -> list[MetricRow]:
    """Distances between garments as they were made and as each code gives them back, and its size.

    Garments of the types that have a template are compared; for the VAEs the code is the mean of
    the posterior. `registered` are the two registrations without any code: what is lost there no
    code can give back. What a code does without, such as the body's shape, is known to all that
    need it and is not counted.

    Args:
        data: registered to the body.
        outfits: the same garments as they were made.
        models: variant -> trained static VAE.
        spaces: type -> principal components of template vertices.
        tables: type -> outfit -> where the template lies on its garment.
        components: of the PCA on offsets, at most.
        split: whose garments are compared.
        seed: of the intervals.
    """
    types = [GARMENTS.index(name) for name in spaces]
    rows = data.rows(split)
    rows = rows[np.isin(data.garment[rows], types)]
    made = _as_made(outfits, data, rows)
    truth = static_truth(next(iter(models.values())), data)

    def on_body(row: int, offsets: np.ndarray, mask: np.ndarray) -> Mesh:
        return garment_mesh(truth.body(row) + offsets, truth.faces(row), mask)

    def on_template(row: int, vertices: np.ndarray) -> Mesh:
        name = GARMENTS[data.garment[row]]
        return Mesh(remesh(vertices, tables[name][data.outfit[row]]), spaces[name].faces)

    def by_space(row: int, vertices: np.ndarray) -> Mesh:
        space, mesh = spaces[GARMENTS[data.garment[row]]], on_template(row, vertices)
        return Mesh(space.vertices(space.coefficients(mesh.vertices)), space.faces)

    pca = fit_pca(data.offsets, data.mask, data.rows("train"), components)
    numbers: dict[str, Callable[[int], int]] = {
        "body_pca": lambda row: len(pca.axes),
        "garment4d_pca": lambda row: len(spaces[GARMENTS[data.garment[row]]].components),
    }
    rebuild: dict[str, Rebuild] = {
        "body_registered": lambda row, _: on_body(row, data.offsets[row], data.mask[row]),
        "body_pca": lambda row, _: on_body(row, *pca.rebuild(data.offsets[row])),
        "template_registered": on_template,
        "garment4d_pca": by_space,
    }
    for variant, model in models.items():
        codes = encode_garments(model, data, rows)
        decoded = decode_codes(model, codes.mean, data.cvar(rows), data.topology(rows))
        found = dict(zip(rows.tolist(), decoded, strict=True))
        rebuild[variant] = lambda row, _, found=found: on_body(row, *found[row])
        numbers[variant] = lambda row, size=codes.mean.shape[1]: size
    result = []
    for variant, mesh_of in rebuild.items():
        measures = []
        for row in progress(rows.tolist(), total=len(rows), label=variant):
            original = made[row]
            there, back = area_distances_mm(mesh_of(row, original.vertices), original)
            found = {"surface_to_true_mm": there, "true_to_surface_mm": back}
            if variant in numbers:
                found["code_numbers"] = numbers[variant](row)
            measures.append(found)
        result += summary_rows(
            rng_for(seed, "intervals", MODEL, variant, split),
            measures,
            [GARMENTS[kind] for kind in data.garment[rows]],
            data.outfit[rows],
            model=MODEL,
            variant=variant,
            split=split,
            seed=seed,
        )
    return result


def _as_made(
    outfits: Iterable[StaticOutfit], data: StaticData, rows: np.ndarray
) -> dict[int, Mesh]:
    """Row -> the garment before any registration."""
    wanted = {(str(data.outfit[r]), GARMENTS[data.garment[r]]): int(r) for r in rows}
    return {
        wanted[name, garment.name]: Mesh(garment.vertices, triangulate(garment.faces))
        for name, _, outfit in outfits
        for garment in outfit.garments
        if (name, garment.name) in wanted
    }
