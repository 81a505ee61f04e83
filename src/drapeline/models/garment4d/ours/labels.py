"""Labels of points: one network that tells the garments of all types from skin, and each other.

Points also say where on the known body they are. Half of the training windows are worse than
simulated clouds are: with noise, holes or few cameras, and on a body that is off, since a body that
was estimated is. B windows of T clouds of P points, L labels.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

from drapeline.dataset.scans import to_scans
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.learning_data.sequences import CloudData
from drapeline.models.garment4d.canonical import Segmentation, as_level
from drapeline.models.garment4d.data import SequenceWindows, spread_rows
from drapeline.models.garment4d.losses import balance_labels
from drapeline.models.garment4d.ours.body_maps import body_map, map_cells
from drapeline.models.garment4d.settings import LabelStageSettings, SegmentationSettings
from drapeline.models.garment4d.stages import Stage, load_kept_bodies, load_stage
from drapeline.models.layers.linear import linear
from drapeline.models.layers.point_search import SEARCH_ANEW, Searches, SearchMemory, gather_rows
from drapeline.models.training.batches import Batch
from drapeline.models.training.module import fastest_device
from drapeline.outfits.garment_types import BODY, GARMENT_TYPES, LABELS, OUTFIT_TYPES

_CELL_M = 0.05  # of the maps that labels are predicted from
_MAP_WIDTH = 64
_KEPT_BYTES = 1 << 30  # of the answers to searches in windows
_MOST_VALIDATED = 3  # windows of a sequence: long ones would outvote the others


class LabelNetwork(nn.Module):
    """PointNet++ that is shown a map of the body with the mean height of points over each part.

    What tells tops from t-shirts are sleeves, which are out of a ball's reach. The map is of the
    whole sequence, so that labels do not change their mind from frame to frame.
    """

    def __init__(self, settings: SegmentationSettings, rng: torch.Generator) -> None:
        super().__init__()
        layers = settings.scaled_layers()
        self.segmentation = Segmentation(layers, 4, rng)
        self.overview = nn.Sequential(
            linear(map_cells(_CELL_M), _MAP_WIDTH, rng),
            nn.ReLU(),
            linear(_MAP_WIDTH, layers.segmentation[-1].outputs, rng),
        )

    def forward(
        self,
        points: torch.Tensor,
        on_body: torch.Tensor,
        heights: torch.Tensor,
        searches: Searches = SEARCH_ANEW,
    ) -> torch.Tensor:
        """Logits (B, T, P, L).

        Args:
            points: (B, T, P, 3) metres, root frame.
            on_body: (B, T, P, 4) their places on the body.
            heights: (B, cells) `map_heights` of the sequences that they are of.
            searches: among the points of these windows.
        """
        level, order = as_level(torch.cat([points, on_body], dim=-1))
        overview = self.overview(heights).repeat_interleave(points.shape[1], dim=0)
        _, logits = self.segmentation(level, searches, overview)
        return gather_rows(logits, order.argsort(dim=1)).unflatten(0, points.shape[:2])


def map_heights(on_body: np.ndarray) -> np.ndarray:
    """(cells,) float32 map of a whole sequence, of places (F, P, 4) on the body."""
    places = torch.from_numpy(np.array(on_body))
    return body_map(places, places[..., 3:], len(places), _CELL_M)[0].numpy()


class LabelStage(Stage):
    """The network in training, with the cross-entropy of labels that are balanced."""

    checkpoint_type = "garment4d_labels"
    SETTINGS, ERROR = LabelStageSettings, "wrong_share"
    label_weights: torch.Tensor

    def __init__(self, settings: LabelStageSettings) -> None:
        super().__init__(settings)
        self.network = LabelNetwork(settings.network, self.weight_rng())
        self.register_buffer("label_weights", torch.ones(len(LABELS)))
        self._memory = SearchMemory(_KEPT_BYTES)

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, Any]) -> Self:
        """An untrained one, from what `checkpoint_metadata` gave."""
        return cls(LabelStageSettings(**metadata["settings"]))

    def prepare(self, clouds: "LabelledClouds") -> None:
        """Balance labels by their share of the training points."""
        balance = self.settings.loss.balance
        self.label_weights.copy_(balance_labels(clouds.label_share(), balance))

    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Cross-entropy, and the share of wrong labels."""
        # Points are the same in every epoch.
        searches = self._memory.of(batch["window"].tolist()) if self.training else SEARCH_ANEW
        logits = self.network(batch["points"], batch["on_body"], batch["heights"], searches)
        labels = batch["labels"]
        of_points = F.cross_entropy(
            logits.flatten(0, 2), labels.flatten(), self.label_weights, reduction="none"
        )
        wrong = (logits.detach().argmax(-1) != labels).float().mean()
        return {"total": of_points.mean()}, wrong

    @torch.inference_mode()
    def logits(self, points: np.ndarray, on_body: np.ndarray) -> np.ndarray:
        """(F, P, L) of a sequence's points (F, P, 3) at places (F, P, 4) on the body.

        Raises:
            InputError: the sequence is shorter than a window.
        """
        heights = torch.from_numpy(map_heights(on_body)).to(self.device)
        windows = SequenceWindows(len(points), self.settings.training.frames)
        mean = windows.mean((points.shape[1], len(LABELS)))
        for starts in windows.batches():
            given = (
                torch.from_numpy(windows.of(starts, x)).to(self.device) for x in (points, on_body)
            )
            found = self.network(*given, heights.expand(len(starts), -1))
            mean.add(starts, found.cpu().numpy())
        return mean()


def choose_labels(logits: np.ndarray, garment: str) -> np.ndarray:
    """The likeliest labels (...) uint8 by logits (..., L), knowing that a garment is worn.

    Nothing is taken for what is not worn together with it: where that covers the same part of the
    body, as tops do that of t-shirts, it has been taken for the garment, and counts as that.
    """
    asked, scores = LABELS.index(garment), np.array(logits, dtype=np.float64)
    worn = {name for outfit in map(_split, OUTFIT_TYPES) if garment in outfit for name in outfit}
    region = GARMENT_TYPES[garment].region
    for label, name in enumerate(LABELS):
        if name not in (BODY, garment, *worn):
            if region in ("whole", GARMENT_TYPES[name].region):
                scores[..., asked] = np.logaddexp(scores[..., asked], scores[..., label])
            scores[..., label] = -np.inf
    return scores.argmax(axis=-1).astype(np.uint8)


class LabelModel:
    """Tells garments from skin, and each other, in point clouds of a dressed person.

    Args:
        folder: of the training, such as `results/garment4d/labels`.
        device: to run the network on; CUDA where there is such a device if None.

    Attributes:
        names: what labels stand for.
        bodies: of both genders, that it was trained with.

    Raises:
        InputError: a file is missing or damaged, or holds another model.
    """

    names = LABELS

    def __init__(self, folder: str | Path, device: torch.device | str | None = None) -> None:
        self.stage = load_stage(folder, LabelStage).to(torch.device(device or fastest_device()))
        self.bodies = load_kept_bodies(folder)

    def label(
        self,
        points: np.ndarray,
        poses: np.ndarray,
        shape: np.ndarray | Sequence[float],
        *,
        gender: str = GENDERS[0],
        trans: np.ndarray | None = None,
        garment: str | None = None,
    ) -> np.ndarray:
        """Labels (F, P) uint8 of points, indices into `names`.

        Args:
            points: (F, P, 3) metres, Z up.
            poses: (F, 72) SMPL's axis-angle, rad; the root rotation takes the body from Y up to
                Z up.
            shape: (10,) SMPL's shape coefficients.
            gender: "female" or "male".
            trans: (F, 3) position of the root joint in the frame of the clouds, metres; the origin
                if None.
            garment: a type that is known to be worn, one of `names`, if any.

        Raises:
            InputError: arrays have other shapes or are not finite, the clouds are not near the
                body, there are fewer frames than the network takes at once, or no such garment.
        """
        if garment is not None and garment not in LABELS[1:]:
            raise InputError(f"garment: '{garment}', expected one of {', '.join(LABELS[1:])}")
        about = {"poses": poses, "shape": shape, "gender": gender, "trans": trans}
        scans = to_scans(points, about, self.bodies)
        body, sizes = scans.body, {len(scan.points) for scan in scans.scans}
        if len(sizes) > 1:
            raise InputError(
                f"points: clouds of {min(sizes)} to {max(sizes)} points, expected as many in each"
            )
        clouds = np.stack([scan.points for scan in scans.scans])
        places = body_relative_points(self.bodies[body.gender], body.shape, body.poses, clouds)
        logits = self.stage.logits(clouds, places[..., 3:])
        return (
            logits.argmax(-1).astype(np.uint8)
            if garment is None
            else choose_labels(logits, garment)
        )


def _split(outfit_type: str) -> list[str]:
    return outfit_type.split("+")


class LabelledClouds:
    """Windows of clouds as rows to train on.

    All windows come twice: as they are, and worse, on a body that is off.

    Args:
        data: of all garments.
        frames: T.
        stride: from one training window to the next; validation windows do not overlap.
        sources: of training sequences.
    """

    def __init__(
        self, data: CloudData, *, frames: int, stride: int, sources: Sequence[str]
    ) -> None:
        self._data, self._frames, self._sources = data, frames, sources
        train = data.windows("train", frames, stride, sources)
        val = data.windows("val", frames, frames)
        few = [spread_rows(val[val[:, 0] == one], _MOST_VALIDATED) for one in np.unique(val[:, 0])]
        windows = np.concatenate([train, *few])
        # Sequence, first frame and whether it is worse.
        worse = np.tile([0, 1], len(windows))
        self._windows = np.column_stack([np.repeat(windows, 2, axis=0), worse])
        self._rows = {
            "train": np.arange(2 * len(train)),
            "val": np.arange(2 * len(train), len(worse)),
        }
        self._heights = {
            int(one): tuple(map_heights(each[data.rows(one)]) for each in self._places)
            for one in np.unique(windows[:, 0])
        }

    @property
    def _places(self) -> tuple[np.ndarray, np.ndarray]:
        return self._data.on_body, self._data.on_worse_body

    def rows(self, split: str) -> np.ndarray:
        """Rows of "train" or "val"."""
        return self._rows[split]

    def batch(self, rows: np.ndarray) -> Batch:
        """Windows (B,): what the network is given, `labels`, `names`, and the rows as `window`."""
        data = self._data
        points, labels = (data.points, data.worse_points), (data.labels, data.worse_labels)
        parts, names = [], []
        for sequence, start, worse in self._windows[rows].tolist():
            first = int(data.start[sequence]) + start
            parts.append((sequence, slice(first, first + self._frames), worse))
            names.append(f"{data.name[sequence]}/{start}")
        return {
            "points": np.stack([points[worse][span] for _, span, worse in parts]),
            "on_body": np.stack([self._places[worse][span] for _, span, worse in parts]),
            "heights": np.stack([self._heights[sequence][worse] for sequence, _, worse in parts]),
            "labels": np.stack([labels[worse][span] for _, span, worse in parts]).astype(np.int64),
            "names": names,
            "window": rows,
        }

    def label_share(self) -> np.ndarray:
        """(L,) of the training points that have each label."""
        return self._data.label_share("train", self._sources)
