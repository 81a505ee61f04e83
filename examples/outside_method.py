"""A method from elsewhere on drapeline's protocol: cloth as rigid as possible.

A re-implementation of an idea, not of a system: Sorkine and Alexa, "As-rigid-as-possible surface
modeling" (2007). Cloth follows the skin that it lies next to, the more loosely the farther off it
is, and otherwise keeps its shape. It knows nothing of gravity, of friction, or of other garments.

    snakemake protocol                                     # writes results/protocol
    python examples/outside_method.py results/protocol arap
    snakemake score --config predictions=arap              # results/report/score.html

It needs NumPy and SciPy, and of drapeline only what poses a body and reads and writes OBJ files.
"""

import sys
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

import drapeline

REACH_M = 0.02  # cloth this far off the skin follows it half as closely as cloth that touches it
ROUNDS = 20  # of rotations and places in turn


class RigidCloth:
    """A sheet at rest, which other places deform as rigidly as they allow.

    Args:
        rest: (V, 3) metres.
        edges: (E, 2).
    """

    def __init__(self, rest, edges):
        self.rest, self.edges = rest, edges
        count = len(rest)
        weights = np.ones(len(edges))
        adjacency = sp.coo_matrix((weights, edges.T), (count, count))
        adjacency = adjacency + adjacency.T
        self.laplacian = sp.diags(np.asarray(adjacency.sum(axis=1)).ravel()) - adjacency

    def fit(self, start, goals, weights):
        """Places (V, 3) near `goals` (V, 3), by weights (V,), beginning at `start`."""
        solve = splu((self.laplacian + sp.diags(weights)).tocsc()).solve
        one, other = self.edges.T
        sides = self.rest[one] - self.rest[other]
        places = start
        for _ in range(ROUNDS):
            now = places[one] - places[other]
            products = np.zeros((len(self.rest), 3, 3))
            outer = sides[:, :, None] * now[:, None, :]
            np.add.at(products, one, outer)
            np.add.at(products, other, outer)
            u, _, v = np.linalg.svd(products)
            flip = np.linalg.det(u @ v) < 0
            u[flip, :, 2] *= -1
            turns = (u @ v).swapaxes(1, 2)
            turned = np.einsum("eij,ej->ei", (turns[one] + turns[other]) / 2, sides)
            right = weights[:, None] * goals
            np.add.at(right, one, turned)
            np.add.at(right, other, -turned)
            places = solve(right)
        return places


def main(protocol, answers):
    """Answer the question `motion`."""
    genders = "female", "male"
    bodies = {name: drapeline.load_body(protocol / f"bodies/{name}.npz") for name in genders}
    rest_pose = np.load(protocol / "bodies/rest_pose.npz")["rest_pose"]
    for case in sorted((protocol / "motion").iterdir()):
        wearer = np.load(case / "wearer.npz")
        body, shape = bodies[str(wearer["gender"])], wearer["shape"]
        at_rest, _ = drapeline.posed_vertices(body, shape, rest_pose[None])
        pose, trans = wearer["poses"][-1:], wearer["trans"][-1:]
        posed, _ = drapeline.posed_vertices(body, shape, pose, trans)
        for path in sorted(case.glob("*.obj")):
            garment = drapeline.load_obj(path)
            faces = garment.faces
            edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
            edges = np.unique(np.sort(edges, axis=1), axis=0)
            distance, near = KDTree(at_rest[0]).query(garment.vertices)
            away = garment.vertices - at_rest[0][near]
            follows = posed[0][near] + turned(away, at_rest[0], posed[0], near, body.faces)
            weights = np.exp2(-((distance / REACH_M) ** 2)) + 1e-4
            cloth = RigidCloth(garment.vertices.astype(float), edges)
            places = cloth.fit(follows, follows, weights)
            save(answers / "motion" / case.name / path.name, places, faces)


def turned(away, at_rest, posed, near, faces):
    """(V, 3) ways from the nearest vertices of the skin, turned with these."""
    frames = [vertex_frames(surface, faces)[near] for surface in (at_rest, posed)]
    return np.einsum("vij,vj->vi", frames[1] @ frames[0].swapaxes(1, 2), away)


def vertex_frames(surface, faces):
    """(V, 3, 3) orthonormal axes of each vertex: along an edge, along the normal, across both."""
    a, b, c = (surface[faces[:, k]] for k in range(3))
    normals = np.zeros_like(surface)
    along = np.zeros_like(surface)
    for k in range(3):
        np.add.at(normals, faces[:, k], np.cross(b - a, c - a))
    along[faces[:, 0]] = b - a
    along[faces[:, 1]] = c - b
    along[faces[:, 2]] = a - c
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    along -= (along * normals).sum(axis=1, keepdims=True) * normals
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([along, normals, np.cross(along, normals)], axis=-1)


def save(path, places, faces):
    """Write an answer."""
    path.parent.mkdir(parents=True, exist_ok=True)
    drapeline.save_obj(path, drapeline.Mesh(places.astype(np.float32), faces))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
