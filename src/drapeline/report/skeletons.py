"""Picture of a captured skeleton and of the joints that drive a body, before any is simulated."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from drapeline.frames import JOINT_NAMES
from drapeline.motions.joint_map import JointMap
from drapeline.motions.retarget import body_frame
from drapeline.motions.skeleton import Take
from drapeline.report.colours import BLUE, FAINT, INK, QUIET, VERMILION
from drapeline.report.style import saved_figure

_SIDES = {"left": BLUE, "right": VERMILION}
_LINES = 26  # of text over the height of a figure


def plot_skeleton(path: str | Path, take: Take, joint_map: JointMap) -> None:
    """Draw a take in the frame in which it is straightest, from the front and from its left side.

    Joints that drive one of SMPL's are coloured by side and have both names; the others are grey.

    Args:
        path: `.svg` or `.png`.
        take: in its own unit and axes.
        joint_map: which of its joints drive which of SMPL's.
    """
    source = joint_map.indices(take)
    place = take.positions[_straightest_frame(take.positions, source)]
    left, up, forward = body_frame(place, source, take.source)
    driven: dict[int, str] = {}
    for joint, index in source.items():
        driven[index] = f"{driven[index]}, {joint}" if index in driven else joint
    height = place @ up
    margin = 0.05 * np.ptp(height)
    # Somebody who is seen from the front has the left hand on the picture's right.
    views = {"from the front": left, "from its left": -forward}
    with saved_figure(path, width_in=13.0, height_in=8.0, columns=2) as (figure, axes):
        for view, (title, across) in zip(axes, views.items(), strict=True):
            x, y = place @ across, height
            for end, start in enumerate(take.parents):
                if start >= 0:
                    view.plot(x[[start, end]], y[[start, end]], color=QUIET, lw=1, zorder=1)
            view.scatter(x, y, s=10, color=QUIET, zorder=2)
            for index, joint in driven.items():
                colour = _SIDES.get(joint.split("_")[0], INK)
                view.scatter(x[index], y[index], s=36, color=colour, zorder=3)
            view.set_title(title)
            view.set_aspect("equal")
            view.set_ylim(height.min() - margin, height.max() + margin)
            view.set_axis_off()
        _name_joints(axes[0], place @ left, height, driven, take.names)
        lacking = [joint for joint in JOINT_NAMES if joint not in source]
        title = f"{Path(take.source).name}: {len(source)} joints of {len(JOINT_NAMES)}"
        if lacking:
            title += f", none for {', '.join(lacking)}"
        figure.suptitle(title, wrap=True)


def _straightest_frame(positions: np.ndarray, source: dict[str, int]) -> int:
    """The frame in which hips, shoulders and ankles are nearest to one line."""
    hips, shoulders, ankles = (
        positions[:, [source[f"{side}_{part}"] for side in _SIDES]].mean(1)
        for part in ("hip", "shoulder", "ankle")
    )
    height = np.linalg.norm(shoulders - ankles, axis=1)
    way = np.linalg.norm(shoulders - hips, axis=1) + np.linalg.norm(hips - ankles, axis=1)
    return int(np.argmax(height / np.maximum(way, 1e-12)))


def _name_joints(
    axes: Axes, x: np.ndarray, y: np.ndarray, driven: dict[int, str], names: Sequence[str]
) -> None:
    """Write SMPL's and the file's name of each joint beside the figure, at its own height if free.

    Args:
        axes: are widened for the names.
        x, y: (J,) places of the joints.
        driven: joint to SMPL joint.
        names: of the joints.
    """
    middle, half = (x.min() + x.max()) / 2, np.ptp(x) / 2
    line = np.ptp(y) / _LINES
    for sign in (1, -1):
        rows = [j for j in driven if driven[j].startswith("right") == (sign < 0)]
        edge, height = middle + sign * 1.1 * half, y.max()
        for index in sorted(rows, key=lambda j: (-y[j], sign * x[j])):
            height = min(height - line, y[index])
            axes.annotate(
                f"{driven[index]}: {names[index]}",
                (x[index], y[index]),
                (edge, height),
                ha="left" if sign > 0 else "right",
                va="center",
                arrowprops={"arrowstyle": "-", "color": FAINT, "lw": 0.8},
                annotation_clip=False,
            )
