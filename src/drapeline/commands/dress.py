"""`drapeline dress`: somebody in motion, dressed, as a file that other programs open."""

import argparse
import logging
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import drapeline
from drapeline.bodies.model import BodyModel, free_body, load_body
from drapeline.commands.health_table import health_lines
from drapeline.commands.outputs import FOLDER_FORMATS, check_output, write_output
from drapeline.dataset.worst_frame import read_worst_frame
from drapeline.errors import InputError
from drapeline.frames import FPS, GENDERS
from drapeline.generation.dressed_clip import dress_clip
from drapeline.generation.settings import BodySettings, OutfitSettings
from drapeline.geometry.obj import save_obj
from drapeline.motions.importing import import_motion
from drapeline.motions.variation import cut_piece
from drapeline.outfits.fabrics import FABRICS
from drapeline.outfits.garment_types import GARMENTS, OUTFIT_TYPES
from drapeline.outfits.settings import OwnGarment
from drapeline.outfits.user_garment import garment_type
from drapeline.report.dataset.gallery import render_gallery
from drapeline.report.dataset.people import LEAST_FRAMES

LOGGER = logging.getLogger("drapeline")
_BMI = (19.0, 27.0)  # of somebody whom nobody asked for
_SHAPE_RANGE = 1.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "motion", help="motion capture: .bvh, .amc with its .asf beside it, .npz of AMASS or ours"
    )
    parser.add_argument(
        "-o",
        "--output",
        action="append",
        metavar="FILE",
        help="what to write, given once or several times: .glb; .html, which plays; .webp, a moving"
        " picture; .usdc (with usd-core or bpy); .abc (with bpy); or with --as a folder."
        " Default: the motion's name with .glb",
    )
    parser.add_argument(
        "--as",
        dest="folder_format",
        choices=FOLDER_FORMATS,
        default="cloth3d",
        help="what an output without a suffix is: a sample in CLOTH3D's format (the default), or"
        " OBJ files, one for each frame, or caches of points beside an OBJ file",
    )
    parser.add_argument(
        "--outfit",
        metavar="TYPE",
        help=f"{', '.join(OUTFIT_TYPES)}; in any order and case (default: what a garment of your"
        " own goes with, else Tshirt+Trousers)",
    )
    parser.add_argument(
        "--garment",
        action="append",
        default=[],
        metavar="[TYPE=]FILE",
        help=f"a garment of your own, an OBJ on the rest body, for one of {', '.join(GARMENTS)};"
        " without the type it is found out",
    )
    parser.add_argument(
        "--model",
        nargs="?",
        const="gcvae",
        metavar="NAME",
        help="draw garments from a trained model of garments at rest, one that comes with drapeline"
        " or a folder (without a name: gcvae), in place of cutting them; needs drapeline[torch]",
    )
    parser.add_argument(
        "--mend",
        action="store_true",
        help="turn, move or scale a garment that could not be worn but for that",
    )
    parser.add_argument(
        "--fabric", choices=sorted(FABRICS), metavar="NAME", help=", ".join(sorted(FABRICS))
    )
    parser.add_argument("--gender", choices=GENDERS, default="female")
    parser.add_argument(
        "--body", metavar="FILE", help="a body in SMPL's format, .npz or .pkl, of that gender"
    )
    parser.add_argument("--bmi", type=float, metavar="KG_M2", help="the wearer's body mass index")
    parser.add_argument("--seed", type=int, default=0, help="of body and outfit (default: 0)")
    parser.add_argument("--start", type=int, default=0, metavar="N", help="first frame, at 30 Hz")
    parser.add_argument(
        "--frames", type=int, metavar="N", help="how many, at 30 Hz (default: all of them)"
    )
    parser.add_argument("--edge-length", type=float, metavar="M", help="of cloth (default: 0.02)")
    parser.add_argument("--joint-map", metavar="FILE", help="for a skeleton of unknown names")


def run(args: argparse.Namespace) -> int:
    """Dress somebody, write the files, and print what became of the cloth.

    Returns:
        Exit status 0.

    Raises:
        InputError: an argument or a file is wrong, or the cloth is out of its bounds; nothing is
            written then but a picture of the worst frame.
    """
    started = time.perf_counter()
    outputs = [Path(path) for path in args.output or [f"{Path(args.motion).stem}.glb"]]
    for path in outputs:
        check_output(path)
    _check_range("bmi", args.bmi, 10, 60)
    _check_range("edge-length", args.edge_length, 0.005, 0.06)
    motion = import_motion(args.motion, joint_map=args.joint_map)
    if not 0 <= args.start < len(motion):
        raise InputError(f"--start {args.start}: expected 0 to {len(motion) - 1} in {args.motion}")
    if args.frames is not None and args.frames < 1:
        raise InputError(f"--frames {args.frames}: expected at least 1")
    stop = len(motion) if args.frames is None else min(len(motion), args.start + args.frames)
    motion = cut_piece(motion, args.start, stop, speed=1.0, mirrored=False)
    LOGGER.info("motion: %.1f s of %s", len(motion) / FPS, args.motion)
    for path in outputs:
        if path.suffix.lower() == ".webp" and len(motion) < LEAST_FRAMES:
            raise InputError(
                f"{path}: a moving picture of {len(motion)} frames, expected {LEAST_FRAMES} or more"
            )
    body = load_body(args.body or free_body(args.gender))
    own = dict(_own_garment(text, body, args) for text in args.garment)
    wanted = outfit_type(args.outfit, list(own))
    bmi = _BMI if args.bmi is None else (args.bmi, args.bmi)
    outfit = {} if args.edge_length is None else {"edge_length_m": args.edge_length}
    with TemporaryDirectory(prefix="drapeline-") as name:
        sample = Path(name, outputs[0].stem or "dressed")
        if args.model:
            own |= _drawn(args, [one for one in wanted.split("+") if one not in own], Path(name))
        meta = dress_clip(
            sample,
            motion,
            body,
            gender=args.gender,
            outfit_type=wanted,
            own=own,
            fabric=args.fabric,
            bodies=BodySettings(shape_range=_SHAPE_RANGE, bmi_range=bmi),
            outfits=OutfitSettings(**outfit),
            seed=args.seed,
        )
        if meta["status"] != "accepted":
            seen = ""
            if read_worst_frame(sample):
                picture = outputs[0].with_name(f"{sample.name}_{meta['status']}.png")
                picture.parent.mkdir(parents=True, exist_ok=True)
                render_gallery(sample, picture, sample / "moving.png")
                seen = f" ({picture} shows the worst frame)"
            raise InputError(
                f"the cloth was {meta['status']}: {meta['reason']}{seen}; another --seed, --outfit"
                " or --fabric, or fewer --frames, may do"
            )
        measures = {"worst garment": meta["simulation"]["attempts"][-1]["measures"]}
        for line in health_lines(measures):
            LOGGER.info("%s", line)
        for path in outputs:
            write_output(path, sample, args.folder_format)
            LOGGER.info("wrote %s (%.1f MB)", path, _size(path) / 1e6)
    LOGGER.info("%.0f s in all", time.perf_counter() - started)
    return 0


def _own_garment(text: str, body: BodyModel, args: argparse.Namespace) -> tuple[str, OwnGarment]:
    """Type of a garment of one's own, and the garment."""
    name, equals, path = text.partition("=")
    if not equals or not _known(name):
        name, path = "", text
    return (
        _known(name) or garment_type(path, body, mend=args.mend),
        OwnGarment(path=path, fabric=args.fabric, mend=args.mend),
    )


def _drawn(args: argparse.Namespace, types: Sequence[str], folder: Path) -> dict[str, OwnGarment]:
    """Garments that a model draws for the rest body, by type.

    Raises:
        InputError: there is no such model, it is of another kind, or knows no garment of a type.
        ModuleNotFoundError: drapeline[torch] is not installed.
    """
    model = drapeline.load(args.model)
    if not isinstance(model, drapeline.StaticModel):
        raise InputError(
            f"{args.model}: a {type(model).__name__}, expected a model that draws garments at rest,"
            " such as gcvae"
        )
    found = {}
    for name in types:
        (drawn,) = model.sample(
            1, name, gender=args.gender, shape=[0.0] * 10, tightness=[0.0, 0.0], seed=args.seed
        )
        path = folder / f"{name}.obj"
        save_obj(path, drawn.mesh)
        found[name] = OwnGarment(path=str(path), fabric=args.fabric)
        LOGGER.info("%s: drawn from %s", name, args.model)
    return found


def _known(name: str) -> str:
    return next((garment for garment in GARMENTS if garment.lower() == name.strip().lower()), "")


def outfit_type(wanted: str | None, own: Sequence[str]) -> str:
    """The one of `OUTFIT_TYPES` that is wanted, or that garments of one's own go with.

    Args:
        wanted: garments in any order and case, joined by "+".
        own: types of one's own garments.

    Raises:
        InputError: there is none.
    """
    if wanted is None:
        with_own = [kind for kind in OUTFIT_TYPES if set(own) <= set(kind.split("+"))]
        if not with_own:
            raise InputError(
                f"--garment: nobody wears {' and '.join(own)}, expected what goes together:"
                f" {', '.join(OUTFIT_TYPES)}"
            )
        return with_own[0]
    names = {_known(name) or name for name in wanted.split("+")}
    for kind in OUTFIT_TYPES:
        if set(kind.split("+")) == names:
            if missing := set(own) - names:
                raise InputError(f"--garment: a {missing.pop()}, but --outfit is {wanted}")
            return kind
    raise InputError(f"--outfit {wanted}: expected one of {', '.join(OUTFIT_TYPES)}")


def _check_range(name: str, value: float | None, low: float, high: float) -> None:
    if value is not None and not low <= value <= high:
        raise InputError(f"--{name} {value:g}: expected {low:g} to {high:g}")


def _size(path: Path) -> int:
    if path.is_file():
        return path.stat().st_size
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
