"""Cloth that has passed through cloth is led back out.

Edges that pass through triangles are moved in the direction that shortens the contour along which
the cloth cuts itself (Volino and Magnenat-Thalmann 2006, "Resolving surface collisions through
intersection contour minimization"). No inside or outside has to be known for that.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

_DEVICE = "cpu"
_SLOTS = 3  # triangles that an edge may pass through
_MOST = wp.constant(_SLOTS)
_SOFT = wp.constant(0.1)  # contours that bend less than this are moved more slowly


@wp.func
def _hit(p: wp.vec3, d: wp.vec3, a: wp.vec3, ab: wp.vec3, ac: wp.vec3):
    # Where p + t d passes through a triangle: t, and weights of b and c; t is -1 if it does not.
    normal = wp.cross(ab, ac)
    slope = wp.dot(d, normal)
    if wp.abs(slope) < 1.0e-14:
        return wp.vec3(-1.0, 0.0, 0.0)
    t = wp.dot(a - p, normal) / slope
    if t < 0.0 or t > 1.0:
        return wp.vec3(-1.0, 0.0, 0.0)
    r = p + d * t - a
    square = wp.length_sq(normal)
    u = wp.dot(wp.cross(r, ac), normal) / square
    v = wp.dot(wp.cross(ab, r), normal) / square
    if u < 0.0 or v < 0.0 or u + v > 1.0:
        return wp.vec3(-1.0, 0.0, 0.0)
    return wp.vec3(t, u, v)


@wp.kernel
def _find_crossings(
    place: wp.array(dtype=wp.vec3),
    edges: wp.array(dtype=wp.vec2i),
    triangles: wp.array(dtype=wp.vec3i),
    near_count: wp.array(dtype=int),
    near: wp.array2d(dtype=int),
    count: wp.array(dtype=int),
    crossed: wp.array2d(dtype=int),
):
    edge = wp.tid()
    ends = edges[edge]
    p = place[ends[0]]
    d = place[ends[1]] - p
    found = int(0)  # noqa: RUF046, UP018
    for k in range(near_count[ends[0]] + near_count[ends[1]]):
        number = int(0)  # noqa: RUF046, UP018
        if k < near_count[ends[0]]:
            number = wp.abs(near[ends[0], k]) - 1
        else:
            number = wp.abs(near[ends[1], k - near_count[ends[0]]]) - 1
        c = triangles[number]
        new = found < _MOST and c[0] != ends[0] and c[1] != ends[0] and c[2] != ends[0]
        if c[0] == ends[1] or c[1] == ends[1] or c[2] == ends[1]:
            new = False
        for n in range(found):
            if crossed[edge, n] == number:
                new = False
        if new:
            a = place[c[0]]
            if _hit(p, d, a, place[c[1]] - a, place[c[2]] - a)[0] >= 0.0:
                crossed[edge, found] = number
                found += 1
    count[edge] = found


@wp.kernel
def _free_crossed(
    edges: wp.array(dtype=wp.vec2i),
    count: wp.array(dtype=int),
    crossed: wp.array2d(dtype=int),
    near_count: wp.array(dtype=int),
    near: wp.array2d(dtype=int),
):
    # The ends of an edge that passes through a triangle are on no side of it.
    edge = wp.tid()
    for k in range(count[edge]):
        for end in range(2):
            vertex = edges[edge][end]
            kept = int(0)  # noqa: RUF046, UP018
            for n in range(near_count[vertex]):
                if wp.abs(near[vertex, n]) - 1 != crossed[edge, k]:
                    near[vertex, kept] = near[vertex, n]
                    kept += 1
            near_count[vertex] = kept


@wp.func
def _along(normal: wp.vec3, p: wp.vec3, way: wp.vec3, far: wp.vec3):
    # Where the contour runs from an edge into the face whose third corner is `far`.
    inward = far - p - way * wp.dot(far - p, way)
    line = wp.normalize(wp.cross(normal, wp.cross(way, inward)))
    if wp.dot(line, inward) < 0.0:
        line = -line
    return line


@wp.kernel
def shorten_contours(
    count: wp.array(dtype=int),
    crossed: wp.array2d(dtype=int),
    edges: wp.array(dtype=wp.vec2i),
    far_corners: wp.array(dtype=wp.vec2i),
    triangles: wp.array(dtype=wp.vec3i),
    inverse_mass: wp.array(dtype=float),
    step: float,
    before: wp.array(dtype=wp.vec3),
    place: wp.array(dtype=wp.vec3),
):
    """Move edges and the triangles that they pass through by at most `step` metres."""
    edge = wp.tid()
    i = edges[edge][0]
    j = edges[edge][1]
    for k in range(count[edge]):
        c = triangles[crossed[edge, k]]
        p = place[i]
        d = place[j] - p
        a = place[c[0]]
        ab = place[c[1]] - a
        ac = place[c[2]] - a
        hit = _hit(p, d, a, ab, ac)
        t = hit[0]
        if t >= 0.0:
            normal = wp.normalize(wp.cross(ab, ac))
            way = wp.normalize(d)
            line = _along(normal, p, way, place[far_corners[edge][0]])
            if far_corners[edge][1] >= 0:
                line = line + _along(normal, p, way, place[far_corners[edge][1]])
            slope = wp.dot(way, normal)
            if wp.abs(slope) < 0.2:
                slope = 0.2 * wp.sign(slope)
            gradient = line - normal * (wp.dot(way, line) / slope)
            size = wp.length(gradient)
            move = gradient * (step / wp.sqrt(size * size + _SOFT * _SOFT))
            wi = inverse_mass[i] * (1.0 - t)
            wj = inverse_mass[j] * t
            w = 1.0 - hit[1] - hit[2]
            wa = inverse_mass[c[0]] * w
            wb = inverse_mass[c[1]] * hit[1]
            wc = inverse_mass[c[2]] * hit[2]
            share = 1.0 / (wi * (1.0 - t) + wj * t + wa * w + wb * hit[1] + wc * hit[2])
            move = move * share
            place[i] = place[i] + move * wi
            place[j] = place[j] + move * wj
            place[c[0]] = place[c[0]] - move * wa
            place[c[1]] = place[c[1]] - move * wb
            place[c[2]] = place[c[2]] - move * wc
            before[i] = before[i] + move * wi
            before[j] = before[j] + move * wj
            before[c[0]] = before[c[0]] - move * wa
            before[c[1]] = before[c[1]] - move * wb
            before[c[2]] = before[c[2]] - move * wc


class Crossings:
    """Which triangles the edges of the cloth pass through.

    Args:
        edges: (E, 2) of the cloth, without diagonals.
        triangles: (F, 3).
    """

    def __init__(self, edges: wp.array, triangles: wp.array) -> None:
        self._edges, self._triangles = edges, triangles
        self.count = wp.zeros(len(edges), dtype=int, device=_DEVICE)
        self.crossed = wp.zeros((len(edges), _SLOTS), dtype=int, device=_DEVICE)

    def find(self, place: wp.array, near_count: wp.array, near: wp.array) -> None:
        """Find them again, among the triangles that the ends of an edge are near to.

        These lose what their edges pass through.

        Args:
            place: (V, 3) vertices.
            near_count, near: of `NearTriangles`.
        """
        wp.launch(
            _find_crossings,
            dim=len(self._edges),
            inputs=[place, self._edges, self._triangles, near_count, near],
            outputs=[self.count, self.crossed],
            device=_DEVICE,
        )
        wp.launch(
            _free_crossed,
            dim=len(self._edges),
            inputs=[self._edges, self.count, self.crossed],
            outputs=[near_count, near],
            device=_DEVICE,
        )
