"""Cloth against a moving body: each vertex keeps to the outer side of the point nearest to it.

That point, the vertex's anchor, moves with the body between frames and carries a plane along. It is
searched again where the cloth has slid over the body, so that most searches are saved.
"""

from collections.abc import Sequence

import numpy as np
import warp as wp

from drapeline.geometry.lanes import LaneInts, make_patches, repeat_first
from drapeline.simulation.collider import MovingBody
from drapeline.xpbd.contact import KEPT_M, ROUNDED, SHARE_OF_CLEARANCE, pushed_out
from drapeline.xpbd.lanes import look_in_lanes, search_in_lanes
from drapeline.xpbd.limbs import hand_numbers, home_limbs, split_limbs

wp.set_module_options({"enable_backward": False})

_TORN = wp.constant(1.4)  # stretch from which cloth lets go of what it is not worn on
_FAR = wp.constant(1.0e3)  # metres, where nothing is near
_SKIN = wp.constant(1.0e-5)  # metres above a surface, where a ray from it starts


@wp.func
def _face_normal(points: wp.array[wp.vec3], face: wp.vec3i):
    a = points[face[0]]
    return wp.cross(points[face[1]] - a, points[face[2]] - a)


@wp.kernel
def _find_normals(
    points: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    first: wp.array[int],
    beside: wp.array[int],  # faces at a vertex, from its `first` to that of the next
    normals: wp.array[wp.vec3],
):
    i = wp.tid()
    normal = wp.vec3()
    for k in range(first[i], first[i + 1]):
        normal += _face_normal(points, faces[beside[k]])
    normals[i] = wp.normalize(normal)


@wp.kernel
def _move_surface(
    start: wp.array[wp.vec3],
    end: wp.array[wp.vec3],
    clock: wp.array[float],
    points: wp.array[wp.vec3],
):
    i = wp.tid()
    points[i] = start[i] + (end[i] - start[i]) * clock[0]


@wp.func
def _blend(values: wp.array[wp.vec3], face: wp.vec3i, weights: wp.vec3):
    return (
        values[face[0]] * weights[0] + values[face[1]] * weights[1] + values[face[2]] * weights[2]
    )


@wp.func
def _let_go(strain: float, strange: int):
    # Torn cloth keeps to nothing but what it is worn on.
    return strain > _TORN and strange > 0


@wp.kernel
def _choose_reaches(
    homes: wp.array[int],
    last: int,  # the number of the whole body
    strain: wp.array[float],
    faces: wp.array[wp.vec3i],
    points: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    home_reach: float,
    reach: float,
    gap: float,
    slack: float,
    anchor: wp.array[int],
    weights: wp.array[wp.vec3],
    away: wp.array[wp.vec3],
    strange: wp.array[int],
    reaches: wp.array[float],  # how far each anchor is looked for, 0 for one that is kept
    found: wp.array[int],
):
    i = wp.tid()
    far = wp.where(homes[i] < last, home_reach, reach)
    if anchor[i] >= 0 and not _let_go(strain[i], strange[i]):
        from_anchor = place[i] - _blend(points, faces[anchor[i]], weights[i])
        slid = wp.length(from_anchor - away[i])
        # Cloth off the body may move by half of its distance before it can touch anything.
        if slid <= wp.max(slack, 0.5 * (wp.length(away[i]) - gap)):
            far = 0.0
        elif strange[i] == 0:
            # The nearest point is no farther than the last one, which is on the same limb.
            far = wp.min(far, 1.01 * wp.length(from_anchor) + 1.0e-6)
    reaches[i] = far
    found[i] = -1


@wp.kernel
def search_one_per_thread(
    meshes: wp.array[wp.uint64],  # of each limb, and of the whole body
    homes: wp.array[int],
    place: wp.array[wp.vec3],
    reach: float,
    reaches: wp.array[float],
    parts: wp.array[int],
    found: wp.array[int],
    found_weights: wp.array[wp.vec3],
):
    """Find the nearest point on each vertex's limb or, if that is too far, on the whole body."""
    i = wp.tid()
    far = reaches[i]
    part = homes[i]
    last = len(meshes) - 1
    while far > 0.0 and part >= 0:
        hit = wp.mesh_query_point_no_sign(meshes[part], place[i], far)
        if hit.result:
            parts[i] = part
            found[i] = hit.face
            found_weights[i] = wp.vec3(hit.u, hit.v, 1.0 - hit.u - hit.v)
        far = reach
        part = wp.where(hit.result or part == last, -1, last)


@wp.kernel
def _take_anchors(
    first_face: wp.array[int],
    face_numbers: wp.array[int],
    homes: wp.array[int],
    hands: wp.array[int],
    last: int,
    strain: wp.array[float],
    faces: wp.array[wp.vec3i],
    points: wp.array[wp.vec3],
    start: wp.array[wp.vec3],
    end: wp.array[wp.vec3],
    start_normals: wp.array[wp.vec3],
    end_normals: wp.array[wp.vec3],
    clock: wp.array[float],
    place: wp.array[wp.vec3],
    # What was found of those that were looked for: on which part, and which of its faces or -1.
    reaches: wp.array[float],
    parts: wp.array[int],
    found: wp.array[int],
    found_weights: wp.array[wp.vec3],
    # The anchor: its face or -1, weights of the corners, and the way from it to the vertex.
    anchor: wp.array[int],
    weights: wp.array[wp.vec3],
    away: wp.array[wp.vec3],
    strange: wp.array[int],  # 0 on the vertex's own limb, 1 elsewhere, 2 and 3 on hands
    # Its place and normal at both ends of the frame.
    from_place: wp.array[wp.vec3],
    to_place: wp.array[wp.vec3],
    from_normal: wp.array[wp.vec3],
    to_normal: wp.array[wp.vec3],
):
    i = wp.tid()
    p = place[i]
    search = reaches[i] > 0.0
    if search:
        old = anchor[i]
        last_strange = strange[i]
        if _let_go(strain[i], last_strange):
            old = -1
        anchor[i] = -1
        strange[i] = 0
        if found[i] >= 0:
            number = face_numbers[first_face[parts[i]] + found[i]]
            here = _blend(points, faces[number], found_weights[i])
            normal = _face_normal(points, faces[number])
            within = wp.dot(p - here, normal) < 0.0
            foreign = int(0)  # noqa: RUF046, UP018
            if parts[i] == last and homes[i] != last:
                foreign = 1
            if parts[i] == last and hands[number] > 0:
                foreign = 1 + hands[number]
            free = foreign > 0 and strain[i] > _TORN
            if foreign > 1 and last_strange != foreign and within:
                free = True
            if not free:
                # In the body: stay with the side that it came from if another is nearer now.
                keep = False
                if old >= 0 and within:
                    keep = wp.dot(_face_normal(points, faces[old]), normal) < 0.0
                if keep:
                    anchor[i] = old
                    strange[i] = last_strange
                else:
                    anchor[i] = number
                    weights[i] = found_weights[i]
                    strange[i] = foreign
                away[i] = p - _blend(points, faces[anchor[i]], weights[i])
    # Within a frame, those that were not searched again are known.
    if anchor[i] >= 0 and (search or clock[0] == 0.0):
        face = faces[anchor[i]]
        from_place[i] = _blend(start, face, weights[i])
        to_place[i] = _blend(end, face, weights[i])
        from_normal[i] = _blend(start_normals, face, weights[i])
        to_normal[i] = _blend(end_normals, face, weights[i])


@wp.kernel
def _aim(
    faces: wp.array[wp.vec3i],
    points: wp.array[wp.vec3],
    anchor: wp.array[int],
    weights: wp.array[wp.vec3],
    clearance: float,
    starts: wp.array[wp.vec3],
    ways: wp.array[wp.vec3],
    reaches: wp.array[float],
):
    """Rays from anchors along the body's normals, of no length where there is no anchor."""
    i = wp.tid()
    reaches[i] = 0.0
    if anchor[i] >= 0:
        face = faces[anchor[i]]
        ways[i] = wp.normalize(_face_normal(points, face))
        starts[i] = _blend(points, face, weights[i]) + ways[i] * _SKIN
        reaches[i] = clearance


@wp.kernel
def look_one_per_thread(
    whole: wp.uint64,
    starts: wp.array[wp.vec3],
    ways: wp.array[wp.vec3],
    reaches: wp.array[float],
    facing: wp.array[int],
    facing_weights: wp.array[wp.vec3],
):
    """Find the face of the body that each ray hits first, -1 for none."""
    i = wp.tid()
    facing[i] = -1
    if reaches[i] > 0.0:
        hit = wp.mesh_query_ray(whole, starts[i], ways[i], reaches[i])
        if hit.result:
            facing[i] = hit.face
            facing_weights[i] = wp.vec3(hit.u, hit.v, 1.0 - hit.u - hit.v)


@wp.kernel
def _measure_clearance(
    faces: wp.array[wp.vec3i],
    points: wp.array[wp.vec3],
    start: wp.array[wp.vec3],
    end: wp.array[wp.vec3],
    ways: wp.array[wp.vec3],
    facing: wp.array[int],
    facing_weights: wp.array[wp.vec3],
    from_place: wp.array[wp.vec3],
    to_place: wp.array[wp.vec3],
    from_normal: wp.array[wp.vec3],
    to_normal: wp.array[wp.vec3],
    clearance: wp.array[wp.vec2],  # at both ends of the frame
):
    """Distances above the anchors at which the body faces itself, along the anchors' normals."""
    i = wp.tid()
    clearance[i] = wp.vec2(_FAR, _FAR)
    if facing[i] < 0:
        return
    face = faces[facing[i]]
    if wp.dot(_face_normal(points, face), ways[i]) < 0.0:
        first = _blend(start, face, facing_weights[i]) - from_place[i]
        last = _blend(end, face, facing_weights[i]) - to_place[i]
        clearance[i] = wp.vec2(
            wp.max(wp.dot(first, wp.normalize(from_normal[i])), 0.0),
            wp.max(wp.dot(last, wp.normalize(to_normal[i])), 0.0),
        )


@wp.struct
class Planes:
    """What keeps each vertex off the body: a plane through its anchor that moves in a frame.

    Attributes:
        anchor: (V,) face of the body, -1 for none.
        from_place, to_place, from_normal, to_normal: (V, 3) at the frame's two ends.
        clearance: (V,) room above the anchor at both ends.
    """

    anchor: wp.array[int]
    from_place: wp.array[wp.vec3]
    to_place: wp.array[wp.vec3]
    from_normal: wp.array[wp.vec3]
    to_normal: wp.array[wp.vec3]
    clearance: wp.array[wp.vec2]


@wp.func
def _place_of(planes: Planes, i: int, time: float):
    return planes.from_place[i] + (planes.to_place[i] - planes.from_place[i]) * time


@wp.func
def _normal_of(planes: Planes, i: int, time: float):
    # A mean of unit vectors is not longer than 1.
    return planes.from_normal[i] + (planes.to_normal[i] - planes.from_normal[i]) * time


@wp.func
def _open(planes: Planes, i: int):
    return wp.min(planes.clearance[i][0], planes.clearance[i][1]) >= _FAR


@wp.kernel
def touch_body(
    planes: Planes,
    clock: wp.array[float],
    carry: wp.array[wp.vec3],
    gap: float,
    release: float,
    stick: float,
    friction: wp.array[float],
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
):
    """Push vertices out of the body; those that touch it stick or slide (Coulomb)."""
    i = wp.tid()
    if planes.anchor[i] < 0:
        return
    here = _place_of(planes, i, clock[1])
    up = _normal_of(planes, i, clock[1])
    p = place[i]
    # Most cloth has room, and is higher above the body.
    if wp.dot(p - here, up) > ROUNDED * gap and _open(planes, i):
        return
    normal = wp.normalize(up)
    o = before[i]
    there = _place_of(planes, i, clock[0]) + carry[0]
    height = wp.dot(p - here, normal)
    clearance = planes.clearance[i]
    free = clearance[0] + (clearance[1] - clearance[0]) * clock[1]
    # Another sheet may lie on the other side, and needs as much room as this one.
    least = wp.min(gap, SHARE_OF_CLEARANCE * free)
    most = wp.max(free - 2.0 * gap, 0.5 * free)
    depth = least - height
    over = height - most
    if over > 0.0:
        old = wp.clamp(wp.dot(o - there, normal) - most, 0.0, over)
        released = wp.min(old, release)
        place[i] = p - normal * (over - old + released)
        before[i] = o - normal * released
    if depth > 0.0:
        old = wp.clamp(least - wp.dot(o - there, normal), 0.0, depth)
        way = here - there
        out, then = pushed_out(p, o, way, normal, depth, old, release, friction[i], stick)
        place[i] = out
        before[i] = then


@wp.kernel
def stay_off_body(
    planes: Planes,
    clock: wp.array[float],
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
):
    """Lift vertices that other cloth has pushed into the body; it gives no speed.

    In folds of the body cloth keeps apart from cloth first: there is no room for both.
    """
    i = wp.tid()
    if planes.anchor[i] < 0 or not _open(planes, i):
        return
    from_anchor = place[i] - _place_of(planes, i, clock[1])
    up = _normal_of(planes, i, clock[1])
    if wp.dot(from_anchor, up) < KEPT_M:
        normal = wp.normalize(up)
        lift = normal * wp.max(KEPT_M - wp.dot(from_anchor, normal), 0.0)
        place[i] = place[i] + lift
        before[i] = before[i] + lift


class BodySurface:
    """The body's surface between two frames, and where each vertex of the cloth is nearest to it.

    Each vertex keeps to the limb that it lies on at rest, and touches others only where it is away
    from that one. Where the body faces itself closely, as between an arm and the chest, there is
    less room than the gap asks for on both sides; cloth keeps to its own half.

    Args:
        body: what the cloth collides with.
        garments: vertices (V, 3) of each garment in frame 0.
        parallel: whether each vertex is searched by itself, as on a GPU, not in patches.
    """

    def __init__(
        self, body: MovingBody, garments: Sequence[np.ndarray], *, parallel: bool = False
    ) -> None:
        vertices, count = body.frame(0), sum(map(len, garments))
        flat = np.ascontiguousarray(body.faces, dtype=np.int32)
        self._faces = wp.array(flat, dtype=wp.vec3i)
        self._start, self._end, self._points = (
            wp.array(vertices.astype(np.float32), dtype=wp.vec3) for _ in range(3)
        )
        self._start_normals, self._end_normals = (wp.zeros_like(self._end) for _ in range(2))
        self._beside = _faces_beside(flat, len(vertices))
        self._find_normals()
        homes = home_limbs(vertices, body.segments, np.concatenate(garments))
        *limbs, whole = split_limbs(vertices, body.faces, body.segments)
        parts = [*(p if (homes == k).any() else p[:0] for k, p in enumerate(limbs)), whole]
        self._meshes = [self._index(flat[part]) for part in parts]
        ids = np.array([mesh.id for mesh in self._meshes], dtype=np.uint64)
        self._ids = wp.array(ids, dtype=wp.uint64)
        self._first, self._numbers, self._homes, self._hands = (
            wp.array(numbers.astype(np.int32), dtype=int)
            for numbers in (
                np.cumsum([0, *map(len, parts)])[:-1],
                np.concatenate(parts),
                homes,
                hand_numbers(body.faces, body.segments),
            )
        )
        self._patches = None
        if not parallel:
            patches = repeat_first(make_patches(np.concatenate(garments), homes))
            self._patches = wp.array(patches, dtype=LaneInts)
        self._reaches, self._again = (wp.zeros(count, dtype=float) for _ in range(2))
        self._on_part, self._found = (wp.zeros(count, dtype=int) for _ in range(2))
        self._found_weights = _vectors(count)
        planes = self.planes = Planes()
        planes.anchor = wp.full(count, -1, dtype=int)
        self.strange = wp.zeros(count, dtype=int)
        self._weights, self._away, self._starts, self._ways = (_vectors(count) for _ in range(4))
        planes.from_place, planes.to_place, planes.from_normal, planes.to_normal = (
            _vectors(count) for _ in range(4)
        )
        planes.clearance = wp.zeros(count, dtype=wp.vec2)

    def _index(self, faces: np.ndarray) -> wp.Mesh:
        """Some of the faces (F', 3) for queries; one far away if there are none."""
        if not len(faces):
            far = wp.array(np.full((3, 3), 1e6, np.float32), dtype=wp.vec3)
            return wp.Mesh(far, wp.array([0, 1, 2], dtype=wp.int32))
        return wp.Mesh(self._points, wp.array(faces.ravel(), dtype=wp.int32))

    def move_to(self, vertices: np.ndarray) -> None:
        """Begin a frame, at whose end the surface is at vertices (B, 3)."""
        wp.copy(self._start, self._end)
        wp.copy(self._start_normals, self._end_normals)
        self._end.assign(vertices)
        self._find_normals()

    @property
    def ends(self) -> tuple[wp.array, wp.array, wp.array]:
        """Vertices (B, 3) at both ends of the frame, and their normals at its end."""
        return self._start, self._end, self._end_normals

    @property
    def anchors(self) -> list[wp.array]:
        """What is known of the nearest points of all vertices, to be kept and put back."""
        known = [self.planes.anchor, self.strange, self._weights, self._away]
        return [*known, *self._ends_of_planes]

    @property
    def _ends_of_planes(self) -> list[wp.array]:
        """Places and normals of the planes at both ends of the frame."""
        planes = self.planes
        return [planes.from_place, planes.to_place, planes.from_normal, planes.to_normal]

    def _find_normals(self) -> None:
        wp.launch(
            _find_normals,
            dim=len(self._end),
            inputs=[self._end, self._faces, *self._beside],
            outputs=[self._end_normals],
        )

    def find_anchors(
        self,
        place: wp.array,
        strain: wp.array,
        clock: wp.array,
        *,
        home_reach_m: float,
        reach_m: float,
        gap_m: float,
        slack_m: float,
    ) -> None:
        """Find the anchors of cloth at `place` again where it has slid by more than `slack_m`."""
        wp.launch(
            _move_surface,
            dim=len(self._points),
            inputs=[self._start, self._end, clock],
            outputs=[self._points],
        )
        for mesh in self._meshes:
            mesh.refit()
        last, count = len(self._meshes) - 1, len(place)
        known = [self.planes.anchor, self._weights, self._away, self.strange]
        found = [self._on_part, self._found, self._found_weights]
        wp.launch(
            _choose_reaches,
            dim=count,
            inputs=[
                *(self._homes, last, strain, self._faces, self._points, place),
                *(home_reach_m, reach_m, gap_m, slack_m, *known),
            ],
            outputs=[self._reaches, self._found],
        )
        if self._patches is None:
            inputs = [self._ids, self._homes, place, reach_m, self._reaches]
            wp.launch(search_one_per_thread, dim=count, inputs=inputs, outputs=found)
        else:
            inputs = [self._ids, self._homes, self._patches, place, reach_m, self._reaches]
            wp.launch(
                search_in_lanes,
                dim=len(self._patches),
                inputs=inputs,
                outputs=[self._again, *found],
            )
        wp.launch(
            _take_anchors,
            dim=count,
            inputs=[
                *(self._first, self._numbers, self._homes, self._hands, last, strain),
                *(self._faces, self._points, self._start, self._end),
                *(self._start_normals, self._end_normals, clock, place, self._reaches, *found),
            ],
            outputs=[*known, *self._ends_of_planes],
        )

    def find_clearance(self, clearance_m: float) -> None:
        """Find clearances up to `clearance_m` above the anchors, as a frame begins."""
        count, surface = len(self.planes.anchor), [self._faces, self._points]
        rays = [self._starts, self._ways, self._reaches]
        facing = [self._found, self._found_weights]
        known = [self.planes.anchor, self._weights]
        wp.launch(_aim, dim=count, inputs=[*surface, *known, clearance_m], outputs=rays)
        whole = self._meshes[-1].id
        if self._patches is None:
            wp.launch(look_one_per_thread, dim=count, inputs=[whole, *rays], outputs=facing)
        else:
            inputs = [whole, self._patches, *rays]
            wp.launch(look_in_lanes, dim=len(self._patches), inputs=inputs, outputs=facing)
        wp.launch(
            _measure_clearance,
            dim=count,
            inputs=[
                *(*surface, self._start, self._end, self._ways, *facing),
                *self._ends_of_planes,
            ],
            outputs=[self.planes.clearance],
        )


def _vectors(count: int) -> wp.array:
    return wp.zeros(count, dtype=wp.vec3)


def _faces_beside(faces: np.ndarray, count: int) -> tuple[wp.array, wp.array]:
    """Faces at each of so many vertices: where a vertex's begin (V + 1,), and their numbers."""
    corners = faces.ravel()
    first = np.concatenate([[0], np.cumsum(np.bincount(corners, minlength=count))])
    beside = np.argsort(corners, kind="stable") // 3
    return tuple(wp.array(v.astype(np.int32), dtype=int) for v in (first, beside))
