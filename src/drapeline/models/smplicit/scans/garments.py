"""Garments in segmented scans, and the bodies under them (SMPLicit 4.2)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.bodies.follow import PosedBody, pose_body
from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.rest_body import SHAPES
from drapeline.bodies.settings import BodyFit
from drapeline.dataset.scan_bodies import fit_scan_body
from drapeline.dataset.scans import to_scans
from drapeline.dataset.segmented_scans import SegmentedScan, segment_scans
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import save_obj
from drapeline.metrics.garment import distances_mm
from drapeline.metrics.predictions import BODY, Fits
from drapeline.models.pictures.dressed import Draper, FittedGarment, use_draped
from drapeline.models.smplicit.dressing import BodyShape, decode_worn, keep_topology
from drapeline.models.smplicit.garments import MODEL_OF_GARMENT
from drapeline.models.smplicit.model import SmplicitModel, check_gender, finite
from drapeline.models.smplicit.scans.fit import ScanFits, fit_scan, fit_to_cloth
from drapeline.models.smplicit.settings import FitScan, Meshing
from drapeline.outfits.worn import DrapedSheet, SkinningOptions
from drapeline.registration.to_scan import move_to_scan
from drapeline.rule_log import progress
from drapeline.storage import atomic_folder, save_npz, write_rows

_UP = np.array([0.0, 0.0, 1.0])  # of a scan's world


class DressedScan(NamedTuple):
    """Body and garments found in a scan.

    Attributes:
        skin: its posed triangles, in the scan's world.
        garments: type -> code, and sheets at rest and as worn.
        moved: type -> worn sheet, moved to the points.
    """

    body: BodyState
    skin: Mesh
    garments: dict[str, FittedGarment]
    moved: dict[str, Mesh]


def find_garments(
    scan: SegmentedScan,
    models: Mapping[str, SmplicitModel],
    body_fit: BodyFit,
    settings: FitScan,
    meshing: Meshing,
    seed: int,
    draper: Draper | None,
) -> DressedScan:
    """The body in a scan, then its garments and the body once more.

    Args:
        models: by their names of `FIELD_MODELS`.
        draper: drapes sheets on the body; None for skinning alone.

    Raises:
        InputError: no model knows a garment of the scan, or one has too few points.
    """
    model = next(iter(models.values())).bodies[scan.gender]
    body = fit_scan_body(scan, model, body_fit, seed)
    fits = fit_scan(scan, models, body, body_fit, settings, seed)
    found = fits.joint
    posed, garments = decode_in_scan(scan, models, found.codes, found.body, meshing)
    if draper:
        garments = drape_scan(scan, models, fits, garments, settings, meshing, seed, draper)
    skin = Mesh(posed.posed.astype(np.float32), posed.faces)
    return DressedScan(found.body, skin, garments, move_garments(scan, garments, posed))


def decode_in_scan(
    scan: SegmentedScan,
    models: Mapping[str, SmplicitModel],
    codes: Mapping[str, np.ndarray],
    body: BodyState,
    meshing: Meshing,
) -> tuple[PosedBody, dict[str, FittedGarment]]:
    """The body in a scan, and sheets of codes, at rest and as it wears them in layers."""
    chosen = {name: (models[MODEL_OF_GARMENT[name]], z) for name, z in codes.items()}
    model = next(iter(models.values())).bodies[scan.gender]
    posed = pose_body(model, body.shape, body.pose, body.trans)
    return posed, decode_worn(
        posed, BodyShape(scan.gender, body.shape), chosen, SkinningOptions(), meshing
    )


def drape_garments(
    scan: SegmentedScan,
    models: Mapping[str, SmplicitModel],
    garments: Mapping[str, FittedGarment],
    body: BodyState,
    draper: Draper,
) -> dict[str, DrapedSheet]:
    """Sheets as they hang on the body in a scan; none if that fails."""
    return draper(
        {name: garment.sheet for name, garment in garments.items()},
        next(iter(models.values())).bodies[scan.gender],
        scan.gender,
        body.shape,
        body.pose,
        body.trans,
        _UP,
    )


def drape_scan(
    scan: SegmentedScan,
    models: Mapping[str, SmplicitModel],
    fits: ScanFits,
    garments: Mapping[str, FittedGarment],
    settings: FitScan,
    meshing: Meshing,
    seed: int,
    draper: Draper,
) -> dict[str, FittedGarment]:
    """The garments of a scan as they hang on its body, with codes fitted to that.

    They hang, codes are fitted to points that follow them, and their sheets hang once more. What
    cannot be draped stays as it is. A sheet that has other pieces or openings than that of the
    training code that fits best gives way to it.

    Args:
        scan, models, settings, meshing, seed: as of `find_garments`.
        fits: of the scan.
        garments: of its joint fit, as `decode_in_scan` made them.
    """
    found = fits.joint
    _, nearest = decode_in_scan(scan, models, fits.nearest.codes, found.body, meshing)
    garments = keep_topology(garments, nearest)
    found = found._replace(codes={name: garment.z for name, garment in garments.items()})
    draped = drape_garments(scan, models, garments, found.body, draper)
    if not draped:
        return garments
    codes = fit_to_cloth(scan, models, found, draped, settings, seed)
    _, again = decode_in_scan(scan, models, codes, found.body, meshing)
    again = keep_topology(again, nearest)
    once_more = drape_garments(scan, models, again, found.body, draper)
    return use_draped(again, once_more) if once_more else use_draped(garments, draped)


def move_garments(
    scan: SegmentedScan, garments: Mapping[str, FittedGarment], body: PosedBody
) -> dict[str, Mesh]:
    """Worn sheets, moved to the points of a scan; see `move_to_scan`."""
    worn = {name: garment.posed for name, garment in garments.items()}
    rest = {name: garment.sheet for name, garment in garments.items()}
    return move_to_scan(worn, rest, scan, body)


def find_in_scans(
    scans: Sequence[SegmentedScan],
    models: Mapping[str, SmplicitModel],
    body_fit: BodyFit,
    settings: FitScan,
    meshing: Meshing,
    seed: int,
    draper: Draper | None,
) -> list[DressedScan]:
    """Bodies and garments of scans, by `find_garments`."""
    return [
        find_garments(scan, models, body_fit, settings, meshing, seed, draper)
        for scan in progress(scans, total=len(scans), label="scans")
    ]


def write_found(
    folder: str | Path, scans: Sequence[SegmentedScan], found: Sequence[DressedScan]
) -> None:
    """Write what was found in scans.

    For each scan and garment `{scan}_{garment}_rest.obj`, `{scan}_{garment}_worn.obj`, and moved to
    the points `{scan}_{garment}.obj`; `{scan}_body.obj`; codes in `codes.npz`; `body.npz` as bodies
    of scans are given; and `garments.tsv` with the distances from the points.

    Args:
        folder: to write; replaces an earlier one.
        scans: of one person.
        found: in each of them.
    """
    rows, codes = [], {}
    with atomic_folder(folder) as scratch:
        for scan, one in zip(scans, found, strict=True):
            save_obj(scratch / f"{scan.name}_body.obj", one.skin)
            for name, garment in one.garments.items():
                stem = f"{scan.name}_{name}"
                save_obj(scratch / f"{stem}_rest.obj", garment.sheet)
                save_obj(scratch / f"{stem}_worn.obj", garment.posed)
                save_obj(scratch / f"{stem}.obj", one.moved[name])
                codes[stem] = garment.z
                points = scan.points_of(name)
                rows.append(
                    {
                        "scan": scan.name,
                        "garment": name,
                        "points": len(points),
                        "vertices": len(garment.posed.vertices),
                        "points_to_worn_mm": _mean_distance_mm(points, garment.posed),
                        "points_to_garment_mm": _mean_distance_mm(points, one.moved[name]),
                    }
                )
        save_npz(scratch / "codes.npz", **codes)
        states = [one.body for one in found]
        save_npz(
            scratch / "body.npz",
            poses=np.stack([state.pose for state in states]),
            trans=np.stack([state.trans for state in states]),
            shape=np.mean([state.shape for state in states], axis=0),
            shapes=np.stack([state.shape for state in states]),
            gender=scans[0].gender,
        )
        write_rows(scratch / "garments.tsv", rows)


def _mean_distance_mm(points: np.ndarray, mesh: Mesh) -> float:
    """Rounded to a micrometre; NaN if nothing is left of the garment."""
    return round(float(distances_mm(points, mesh).mean()), 3) if len(mesh.faces) else float("nan")


def shown_scan(found: DressedScan, variant: str) -> Fits:
    """The body and the garments of a variant, for figures."""
    return {BODY: {BODY: found.skin}, variant: found.moved}


def fit_points(
    model: SmplicitModel,
    points: np.ndarray,
    labels: np.ndarray,
    garment: str | None = None,
    *,
    gender: str,
    pose: Sequence[float],
    trans: Sequence[float],
    shape: Sequence[float] = (0.0,) * SHAPES,
    joints: np.ndarray | None = None,
    seed: int = 0,
    draper: Draper | None = None,
) -> DressedScan:
    """The garment in a segmented scan, and the body under it; see `find_garments`.

    Args:
        points: (P, 3) of the dressed person, metres, Z up.
        labels: (P,) 0 for skin, 1 for the garment, 255 for other cloth.
        garment: its type, the first that the model knows if None.
        gender: of the wearer, "female" or "male".
        pose: (72,) axis-angle, rad, as estimated; its root rotation takes the body from Y up to
            Z up.
        trans: (3,) the root joint in the scan, as estimated, metres.
        shape: (10,) as estimated; the mean one if not given.
        joints: (24, 3) positions of the joints in the scan, if they were predicted apart.
        draper: drapes its sheet on the body, see `drapeline.generation.moving_sheets.make_draper`;
            skinned if None.

    Raises:
        InputError: an argument has another size, the points are not in metres, not near the
            body or not labelled, or too few are the garment's.
    """
    check_gender(gender)
    name = garment or model.garments[0]
    parameters = {
        "poses": finite("pose", pose, 72)[None],
        "trans": finite("trans", trans, 3)[None],
        "shape": finite("shape", shape, SHAPES),
        "gender": gender,
    }
    if joints is not None:
        parameters["joints"] = np.asarray(joints)[None]
    scans = to_scans([points], parameters, model.bodies, labels=[labels])
    (scan,) = segment_scans(scans, [name], name="points")
    models = {model.name: model}
    return find_garments(scan, models, BodyFit(), FitScan(), Meshing(), seed, draper)
