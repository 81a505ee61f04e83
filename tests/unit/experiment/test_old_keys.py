import pytest

from drapeline.errors import InputError
from drapeline.experiment.old_keys import refuse_old_keys


@pytest.mark.parametrize(
    ("settings", "old", "new"),
    [
        ({"samples": {"count": 3}}, "samples.count", "groups.dataset.count"),
        ({"learning": {"frames": 3}}, "learning.frames", "groups.learning.motions.frames"),
        ({"static": {"settle_frames": 3}}, "static.settle_frames", "groups.static.outfits.hang_f"),
        ({"static": {"edge_length_m": 1}}, "static.edge_length_m", "groups.static.outfits.edge_l"),
        ({"learning": None}, "learning", "groups.learning"),
        ({"learning": {"nonsense": 1}}, "learning", "groups.learning"),
        ({"scans": {"learning": 3}}, "scans.learning", "scans.count"),
        ({"scans": {"samples": {"points": 900}}}, "scans.samples", "scans.noisy"),
    ],
)
def test_an_old_key_is_refused_with_its_new_name(settings, old, new):
    with pytest.raises(InputError, match=f"mine.yaml: '{old}' is called {new}.* now$"):
        refuse_old_keys({"seed": 1, **settings}, "mine.yaml")


def test_keys_of_today_pass():
    refuse_old_keys({"groups": {"learning": {"count": 3}, "static": {}}, "scans": {}}, "mine.yaml")
