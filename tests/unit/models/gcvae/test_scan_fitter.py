"""Codes from the points of a scan: registration by nearest neighbours, and the fit."""

import numpy as np
import pytest
import torch

from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.labels import LABELS
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.frames import REST_POSE
from drapeline.models.gcvae.codes import decode_codes
from drapeline.models.gcvae.scan_fitter import (
    CodeScanFitter,
    FitCode,
    RegisteredPoints,
    fit_code,
    register_points,
)
from gcvae_toys import VERTICES, ToyGarments, toy_template, tube

STATE = BodyState.of(REST_POSE, np.zeros(3), np.zeros(10))


def scan(garments, **clouds):
    labels = np.repeat([LABELS.index(name) for name in clouds], [len(c) for c in clouds.values()])
    points = np.concatenate([*clouds.values()]).astype(np.float32)
    return SegmentedScan("s", 0, points, labels.astype(np.uint8), garments, "female", STATE, None)


def test_vertices_get_the_nearest_points_and_know_what_is_hidden():
    body = tube()
    cloth, skin, cover = body[96:] * [1.2, 1.2, 1], body[:48], body[48:96] * [1.5, 1.5, 1]
    shown = scan(("Trousers", "Top"), Body=skin, Trousers=cloth, Top=cover)
    found = register_points(body, shown.points, shown, "Trousers")
    np.testing.assert_allclose(found.offsets[96:], 0.2 * body[96:] * [1, 1, 0], atol=1e-6)
    assert not found.mask[:48].any()
    assert found.mask[110:].all()
    assert found.known[:36].all()
    assert not found.known[60:84].any()


@pytest.mark.portable
def test_a_code_rebuilds_the_garment_that_it_was_fitted_to(fitted):
    garments = ToyGarments()
    (row,) = garments.rows("test")[:1]
    registered = RegisteredPoints(
        garments.offsets[row], garments.mask[row], np.ones(VERTICES, dtype=bool)
    )
    cvar, topology = garments.cvar(np.array([row])), garments.topology(np.array([row]))
    fits = [fit_code(fitted, cvar, topology, registered, FitCode(steps=steps)) for steps in (0, 40)]
    errors = []
    for z in fits:
        ((offsets, _),) = decode_codes(fitted, z, cvar, topology)
        away = np.linalg.norm(offsets - registered.offsets, axis=1)[registered.mask]
        errors.append(away.mean())
    with torch.no_grad():
        start = fitted.encode(
            {
                "offsets": torch.from_numpy(registered.offsets)[None],
                "mask": torch.from_numpy(registered.mask)[None],
                "cvar": torch.from_numpy(cvar),
                "topology": torch.from_numpy(topology),
            }
        ).mean
    np.testing.assert_allclose(fits[0], start, atol=1e-5)
    assert errors[1] < 1.05 * errors[0]


def test_every_model_finds_every_garment(fitted, toy_body):
    template = toy_template()
    rest = template.rest_body(np.zeros(13, dtype=np.float32))
    shown = scan(
        ("Trousers", "Top"),
        Body=toy_body.v_template[:200],
        Trousers=rest[:96] * [1.2, 1.2, 1],
        Top=rest[96:] * [1.3, 1.3, 1],
    )
    bodies = {"female": toy_body, "male": toy_body}
    found = CodeScanFitter({"one": fitted, "two": fitted}, bodies, FitCode(steps=2)).fit(
        shown, STATE
    )
    assert {variant: set(garments) for variant, garments in found.items()} == {
        variant: {"Trousers", "Top"} for variant in ("one", "one_moved", "two", "two_moved")
    }
    for mesh in found["one"].values():
        assert np.isfinite(mesh.vertices).all()
