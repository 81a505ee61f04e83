import numpy as np
import pytest

from drapeline.models.gcvae.codec import encode_garments
from drapeline.models.gcvae.decode import static_truth
from drapeline.models.gcvae.evaluate import measure_static
from drapeline.models.training.batches import as_tensors


def test_measures_are_those_of_the_network(model, garments):
    """The metrics of a whole split agree with what Lightning logs in validation, batch by batch."""
    rows = garments.rows("test")
    codes = encode_garments(model, garments, rows)
    measures = measure_static(model, garments, rows, codes)
    batch = as_tensors(garments.batch(rows))
    offsets, mask = model.decode(model.encode(batch).mean, batch["cvar"], batch["topology"])
    true = batch["mask"]
    error = (offsets.detach() - batch["offsets"]).norm(dim=2)
    for i, row in enumerate(measures):
        assert row["surface_error_mm"] == pytest.approx(
            1000 * error[i][true[i]].mean().item(), rel=1e-4
        )
        seen = mask[i] > 0.5
        both, either = (seen & true[i]).sum(), (seen | true[i]).sum()
        assert row["mask_iou"] == pytest.approx((both / either).item(), abs=1e-6)
        assert row["kl_nat"] > 0


def test_the_truth_stands_on_the_bodies_of_the_models_template(model, garments):
    template = model.body_template
    truth = static_truth(template, garments)
    for row in garments.rows("test").tolist():
        body = template.rest_body(garments.cvar(np.array([row]))[0])
        np.testing.assert_array_equal(truth.body(row), body)
        assert truth.faces(row).max() < len(body)
