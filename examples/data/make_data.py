"""Make the files of this folder from what drapeline ships with and from the default experiment.

make run
PYTHONPATH=src:tests .venv/bin/python examples/data/make_data.py
"""

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from drapeline.bodies.model import load_body, posed_vertices
from drapeline.bodies.rest_body import rest_body
from drapeline.dataset.point_clouds import load_clouds, write_clouds
from drapeline.dataset.reader import Cloth3D, Sample
from drapeline.dataset.scene_part import BODY_COLOUR
from drapeline.dataset.segmented_scans import scan_sample
from drapeline.dataset.settings import CloudSettings, ScanSettings
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.geometry.obj import save_obj
from drapeline.models.pictures.read import class_of_garment
from drapeline.motions.importing import import_motion
from drapeline.motions.motion import Motion
from drapeline.motions.skeleton import REFERENCE_OFFSETS
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.garment_types import LABELS
from drapeline.outfits.generate import make_outfit, sample_numbers
from drapeline.outfits.templates import build_templates
from drapeline.rendering.camera import look_at
from drapeline.rendering.modalities import cast_rays
from drapeline.rendering.raytracer import ColouredMesh, raytrace
from drapeline.report.colours import garment_colour
from drapeline.seeding import rng_for
from drapeline.storage import save_npz
from toys.motion_files import write_bvh

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
CLIPS = ROOT / "workflow/resources/motions"
Y_UP = Rotation.from_euler("x", -90, degrees=True)  # from Z up


def write_clip(name: str, frames: int) -> None:
    """A clip as BVH in centimetres, Y up, with the joint names of the CMU conversions."""
    motion = import_motion(CLIPS / f"{name}.npz", frames=frames)
    turns = Rotation.from_rotvec(motion.poses.reshape(-1, 3))
    local = turns.as_matrix().reshape(len(motion), -1, 3, 3)
    local[:, 0] = (Y_UP * Rotation.from_matrix(local[:, 0])).as_matrix()
    root = 100 * Y_UP.apply(motion.trans)
    write_bvh(FOLDER / f"{name}.bvh", local, root, offsets=100 * REFERENCE_OFFSETS, decimals=2)


def write_amass(name: str) -> None:
    """A clip with the keys of an AMASS file of SMPL-H."""
    motion: Motion = import_motion(CLIPS / f"{name}.npz")
    body = motion.poses[:, : 3 * 22].astype(np.float32)
    hands = np.zeros((len(motion), 156 - body.shape[1]), np.float32)
    save_npz(
        FOLDER / f"{name}.npz",
        poses=np.concatenate([body, hands], axis=1),
        trans=motion.trans.astype(np.float32),
        mocap_framerate=np.float64(30),
    )


def write_skirt(body_file: Path) -> None:
    """A pleated skirt of quads around the waist and hips of the female rest body."""
    body = load_body(body_file)
    vertices = rest_body(body, np.zeros(10))
    angles = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    heights = np.linspace(0.12, -0.42, 26)
    rings, radius = [], np.zeros(len(angles))
    for height in heights:
        near = vertices[np.abs(vertices[:, 2] - height) < 0.02, :2]
        # From one ring to the next the skirt only gets wider, as cloth that hangs does.
        radius = np.maximum(radius, _reach(near, directions) + 0.012)
        down = max(0.0, (0.02 - height) / 0.44)
        pleats = 1 + 0.3 * down + 0.05 * down * np.cos(12 * angles)
        ring = (radius * pleats)[:, None] * directions
        rings.append(np.column_stack([ring, np.full(len(angles), height)]))
    index = np.arange(len(heights) * len(angles)).reshape(len(heights), -1)
    above, below = index[:-1], index[1:]
    faces = np.stack([above, below, np.roll(below, -1, 1), np.roll(above, -1, 1)], axis=-1)
    mesh = Mesh(np.concatenate(rings).round(4), faces.reshape(-1, 4).astype(np.int32))
    save_obj(FOLDER / "skirt.obj", mesh)


def write_dress(body_file: Path) -> None:
    """A short-sleeved dress as drapeline cuts it, on the female rest body."""
    body = load_body(body_file)
    cut = OutfitRanges(
        sleeve_length=(0.25, 0.25),
        skirt_length=(0.62, 0.62),
        skirt_alpha1=(0.45, 0.45),
        sewn_waist=(0.9, 0.9),
    )
    outfit = make_outfit(
        sample_numbers(rng_for(0, "dress"), "Dress", cut),
        build_templates(body),
        body,
        gender="female",
        shape=np.zeros(10),
        tightness=np.zeros(2),
        edge_length_m=0.025,
    )
    (dress,) = outfit.garments
    save_obj(FOLDER / "dress.obj", Mesh(dress.vertices, dress.faces, dress.uv, dress.uv_faces))


def _reach(points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Distance from the origin to the convex hull of points around it, in each direction."""
    equations = ConvexHull(points).equations
    toward = directions @ equations[:, :2].T
    with np.errstate(divide="ignore"):
        return np.where(toward > 0, -equations[:, 2] / toward, np.inf).min(axis=1)


def write_scans(dataset: Path, frames: int = 10) -> None:
    """What cameras all around see of a simulated person in a skirt, and the body in it."""
    sample = next(s for s in Cloth3D(dataset, "test") if "Skirt" in s.garments)
    with tempfile.TemporaryDirectory() as scratch:
        clouds = Path(scratch) / "clouds"
        write_clouds(clouds, sample.folder, CloudSettings(points=1200, noise_m=0.002))
        points = load_clouds(clouds).points[:frames] + sample.info.trans[:frames, None]
    save_npz(FOLDER / "scans.npz", points=points.astype(np.float32))
    save_npz(
        FOLDER / "scanned_body.npz",
        poses=sample.info.poses[:frames],
        trans=sample.info.trans[:frames],
        shape=sample.info.shape,
        gender=sample.info.gender,
    )


def write_segmented(sample: Sample) -> None:
    """Labelled points of two frames, and the body roughly as an estimator would give it."""
    body = load_body(ROOT / f"resources/body/{sample.gender}.npz")
    scans = scan_sample(sample, body, ScanSettings(frames=2, points=4000), seed=0)
    codes = {LABELS.index(name): 1 + k for k, name in enumerate(scans[0].garments)} | {0: 0}
    labels = [[codes[label] for label in scan.labels.tolist()] for scan in scans]
    save_npz(
        FOLDER / "segmented.npz",
        points=np.stack([scan.points for scan in scans]).round(4),
        labels=np.array(labels, dtype=np.uint8),
    )
    save_npz(
        FOLDER / "segmented_body.npz",
        poses=np.stack([scan.estimate.pose for scan in scans]).astype(np.float32),
        trans=np.stack([scan.estimate.trans for scan in scans]).astype(np.float32),
        shape=scans[0].estimate.shape.astype(np.float32),
        joints=np.stack([scan.joints for scan in scans]).astype(np.float32),
        gender=sample.gender,
    )


def write_picture(samples: Sequence[Sample], frames: Sequence[int]) -> None:
    """Simulated people side by side, a frame of each: photo, labels, who is where, and the JSON."""
    table, parts, owners, labels, people = ["background", "body"], [], [0], [0], []
    for number, (sample, frame) in enumerate(zip(samples, frames, strict=True), 1):
        info, body = sample.info, load_body(ROOT / f"resources/body/{sample.gender}.npz")
        vertices = posed_vertices(body, info.shape, info.poses[frame][None])[0][0]
        root = np.array([0.75 * number, -0.3 * (number % 2), -vertices[:, 2].min()])
        worn = [(vertices, body.faces, "body", BODY_COLOUR)]
        for garment in sample.garments:
            cloth = sample.vertices(garment, frame, frame + 1, "root")[0]
            faces = triangulate(sample.mesh(garment).faces)
            worn.append((cloth, faces, class_of_garment(garment), garment_colour(garment)))
        for points, faces, name, colour in worn:
            table += [name] * (name not in table)
            parts.append(ColouredMesh(points + root, faces, colour))
            owners.append(number)
            labels.append(table.index(name))
        people.append(
            {
                "gender": sample.gender,
                "shape": info.shape.round(4).tolist(),
                "pose": info.poses[frame].round(4).tolist(),
                "trans": root.round(4).tolist(),
                "instance": number,
            }
        )
    middle = np.array([0.375 * (len(samples) + 1), 0.0, 0.9])
    camera = look_at(middle + [0.5, -4.5, 0.3], middle, focal_px=900, size=(560, 420))
    seen = cast_rays([(p.vertices, p.faces, np.zeros_like(p.vertices)) for p in parts], camera)
    for name, values in (("labels", labels), ("people", owners)):
        pixels = np.array(values, np.uint8)[seen.segments]
        Image.fromarray(pixels).save(FOLDER / f"street_{name}.png", optimize=True)
    photo = raytrace(parts, camera, floor_centre=middle[:2])
    Image.fromarray(photo).save(FOLDER / "street.jpg", quality=88)
    picture = {
        "segmentation": "street_labels.png",
        "labels": {str(label): name for label, name in enumerate(table)},
        "photo": "street.jpg",
        "instances": "street_people.png",
        "camera": {
            "focal_px": 900,
            "centre_px": [280, 210],
            "world_to_camera": camera.world_to_camera.round(6).tolist(),
        },
        "people": people,
    }
    (FOLDER / "street.json").write_text(json.dumps(picture, indent=1) + "\n")


if __name__ == "__main__":
    write_clip("dance_b", frames=90)
    write_clip("jump", frames=60)
    write_amass("kick")
    write_skirt(ROOT / "resources/body/female.npz")
    write_dress(ROOT / "resources/body/female.npz")
    write_scans(ROOT / "results/dataset")
    held_out = [*Cloth3D(ROOT / "results/dataset", "test")]
    write_segmented(held_out[0])
    write_picture(held_out[:3], frames=(12, 30, 45))
