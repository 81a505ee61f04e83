"""Figure 8 of the CLOTH3D paper for our models: the codes of garments in the plane."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from sklearn.manifold import TSNE

from drapeline.report.colours import GARMENT_COLOURS
from drapeline.report.style import saved_figure

_PERPLEXITY = 30.0
_CODES_MAX = 1500  # points of the t-SNE, whose time grows with their square


def plot_codes(
    path: str | Path, codes: np.ndarray, garments: Sequence[str], splits: Sequence[str]
) -> None:
    """Figure 8: the codes of garments in the plane, coloured by type; held-out ones are ringed.

    Args:
        path: the figure.
        codes: (N, Z) means of the codes; of more than 1500, evenly spaced ones are drawn.
        garments, splits: (N,) type and split of each.
    """
    chosen = np.linspace(0, len(codes) - 1, min(len(codes), _CODES_MAX)).astype(int)
    points = np.asarray(codes, dtype=np.float64)[chosen]
    perplexity = min(_PERPLEXITY, (len(points) - 1) / 3)
    place = TSNE(init="pca", perplexity=perplexity, random_state=0).fit_transform(points)
    garments, splits = np.asarray(garments)[chosen], np.asarray(splits)[chosen]
    with saved_figure(path, 6.4, 5.6) as (_, (axes,)):
        for name, colour in GARMENT_COLOURS.items():
            for held_out in (False, True):
                here = (garments == name) & ((splits != "train") == held_out)
                if here.any():
                    axes.scatter(
                        *place[here].T,
                        s=22 if held_out else 11,
                        color=colour,
                        edgecolor="#222222" if held_out else "none",
                        linewidth=0.7,
                        label=None if held_out else name,
                    )
        axes.set_xticks([])
        axes.set_yticks([])
        axes.spines[:].set_visible(False)
        axes.set_aspect("equal")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=6, markerscale=1.6)
