from drapeline.bodies.model import BodyModel as BodyModel
from drapeline.bodies.model import load_body as load_body
from drapeline.dataset.reader import Cloth3D as Cloth3D
from drapeline.dataset.reader import Sample as Sample
from drapeline.dataset.reader import open_dataset as open_dataset
from drapeline.errors import InputError as InputError
from drapeline.frames import JOINT_NAMES as JOINT_NAMES
from drapeline.generation.moving_outfits import SimulatedOutfit as SimulatedOutfit
from drapeline.generation.moving_outfits import simulate as simulate
from drapeline.generation.moving_sheets import SimulatedSheet as SimulatedSheet
from drapeline.geometry.mesh import Mesh as Mesh
from drapeline.geometry.obj import load_obj as load_obj
from drapeline.geometry.obj import save_obj as save_obj
from drapeline.metrics.measure import measure as measure
from drapeline.models.garment4d.reconstruct import ReconstructionModel as ReconstructionModel
from drapeline.models.gcvae.static_model import StaticModel as StaticModel
from drapeline.models.load import load as load
from drapeline.models.smplicit.gallery.motion import repose as repose
from drapeline.models.smplicit.model import SmplicitModel as SmplicitModel
from drapeline.models.smplicit.pictures.drape import fit_image as fit_image
from drapeline.models.smplicit.scans.garments import fit_points as fit_points
from drapeline.motions.floor import floor_report as floor_report
from drapeline.motions.importing import import_motion as import_motion
from drapeline.motions.motion import Motion as Motion
from drapeline.motions.motion import save_motion as save_motion
from drapeline.report.models.scene import draw as draw

__version__: str
