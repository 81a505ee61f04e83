"""Cloth from frame to frame in small steps, and the kernels that move particles in one.

Between prediction and contact a particle's place and its inverse mass stand in one vector of four,
which a processor reads and writes at once.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from drapeline.frames import FPS
from drapeline.geometry.crossings import Crossings
from drapeline.geometry.lanes import LANES, LaneFloats, LaneInts, lay_in_lanes
from drapeline.simulation.collider import MovingBody
from drapeline.simulation.solver import Attempt, ClothGarment
from drapeline.xpbd.body_contact import BodySurface, stay_off_body, touch_body
from drapeline.xpbd.body_vertices import CoveredVertices, push_off_body_vertices
from drapeline.xpbd.cloth_contact import (
    NearTriangles,
    approach_triangles,
    part_triangles,
    touch_cloth,
)
from drapeline.xpbd.contact import make_all_moves, make_moves, touch_floor
from drapeline.xpbd.edge_contact import (
    CrossedTriangles,
    NearEdges,
    approach_edges,
    opposite_vertices,
    part_edges,
    touch_edges,
    untangle,
)
from drapeline.xpbd.elasticity import (
    hinge_numbers,
    measure_strain,
    pull_springs,
    spring_numbers,
    turn_hinges,
)
from drapeline.xpbd.lanes import pull_springs_in_lanes, turn_hinges_in_lanes
from drapeline.xpbd.system import join_garments

wp.set_module_options({"enable_backward": False})


def record(kernel: wp.Kernel, count: int, inputs: list, outputs: list) -> Any:
    """A launch to repeat; nothing if `count`, the number of its threads, is 0."""
    return wp.launch(kernel, dim=count, inputs=inputs, outputs=outputs, record_cmd=True)


class Replay:
    """Launches that are always the same, recorded when they are first called for, to be replayed.

    One by one, each would take Python several microseconds.
    """

    def __init__(self, parts: Sequence[Callable[[], None]]) -> None:
        self._parts = parts
        self._graph: wp.Graph | None = None

    def __call__(self) -> None:
        """Make all launches."""
        if self._graph is None:
            with wp.ScopedCapture() as capture:
                for part in self._parts:
                    part()
            self._graph = capture.graph
        wp.capture_launch(self._graph)


class BusyLaunch:
    """A launch to repeat for those vertices or edges that are near to something, and no others.

    On a GPU, which would wait for their numbers, it is one for all, of which most end at once.

    Args:
        kernel: takes their numbers before its `inputs`.
        count: (N,) how much each of all of them is near to.
        inputs, outputs: of the kernel.
    """

    def __init__(self, kernel: wp.Kernel, count: wp.array, inputs: list, outputs: list) -> None:
        self._count = count
        self._numbers = wp.array(np.arange(len(count), dtype=np.int32), dtype=int)
        self._launch = record(kernel, 1, [self._numbers, *inputs], outputs)
        self._launch.set_dim(0)

    def find(self) -> None:
        """Find them again, after `count` has changed."""
        if self._count.device.is_cuda:
            self._launch.set_dim(len(self._count))
            return
        busy = np.flatnonzero(self._count.numpy())
        self._numbers.numpy()[: len(busy)] = busy
        self._launch.set_dim(len(busy))

    def launch(self) -> None:
        """Launch the kernel for those that were found."""
        self._launch.launch()


class Sweeps:
    """Launches that are repeated until none of them counts anything, or `most` times."""

    def __init__(self, parts: Sequence[Callable[[], None]], counted: wp.array, most: int) -> None:
        self._parts, self._counted, self.most = parts, counted, most

    def __call__(self) -> None:
        """Make the launches."""
        for _ in range(self.most):
            self._counted.zero_()
            for part in self._parts:
                part()
            if not self._counted.numpy()[0]:
                return


_GRAVITY = wp.constant(wp.vec3(0.0, 0.0, -9.81))


@wp.kernel
def tick(steps: int, ticks: wp.array[int], clock: wp.array[float]):
    """Let the clock show when the next of a frame's small steps begins and ends, from 0 to 1."""
    step = ticks[0]
    clock[0] = float(step) / float(steps)
    clock[1] = float(step + 1) / float(steps)
    ticks[0] = (step + 1) % steps


@wp.kernel
def predict(
    keep: wp.array[float],  # share of the speed that the air leaves
    carry: wp.array[wp.vec3],
    step_s: float,
    speed: wp.array[wp.vec3],
    way: wp.array[wp.vec3],
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    weighed: wp.array[wp.vec4],
):
    """Move particles by their speed, gravity and the air alone."""
    i = wp.tid()
    start = place[i] + carry[0]
    free = (speed[i] + _GRAVITY * step_s) * keep[i]
    end = start + free * step_s
    speed[i] = free
    way[i] = end - start  # as it was rounded
    before[i] = start
    weighed[i] = wp.vec4(end[0], end[1], end[2], weighed[i][3])


@wp.kernel
def hold(
    vertices: wp.array[int],
    pull: wp.array[float],
    start: wp.array[wp.vec3],
    end: wp.array[wp.vec3],
    clock: wp.array[float],
    weighed: wp.array[wp.vec4],
):
    """Pull held vertices to where they are held, which moves between two frames."""
    i = wp.tid()
    target = start[i] + (end[i] - start[i]) * clock[1]
    vertex = weighed[vertices[i]]
    goal = wp.vec4(target[0], target[1], target[2], vertex[3])
    weighed[vertices[i]] = vertex + (goal - vertex) * pull[i]


@wp.kernel
def take_places(weighed: wp.array[wp.vec4], place: wp.array[wp.vec3]):
    """Take the places where the cloth's own forces have left particles."""
    i = wp.tid()
    place[i] = wp.vec3(weighed[i][0], weighed[i][1], weighed[i][2])


@wp.kernel
def take_speed(
    way: wp.array[wp.vec3],
    before: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    step_s: float,
    speed: wp.array[wp.vec3],
):
    """Add to the predicted speed what the way of a step became longer than predicted.

    The whole way over the step's time would be the same but for rounding: what gravity adds to a
    way in so short a step is a few units in the last place of the position.
    """
    i = wp.tid()
    speed[i] = speed[i] + (place[i] - before[i] - way[i]) / step_s


@wp.kernel
def add_speed(more: wp.vec3, speed: wp.array[wp.vec3]):
    """Add to the speed of all particles."""
    i = wp.tid()
    speed[i] = speed[i] + more


@dataclass(frozen=True)
class XpbdSettings:
    """Numbers of the method."""

    steps_per_step: float = 3.0  # small steps for each of `Attempt.steps`
    # How far cloth goes past other cloth, as a root mean square, between two searches for what is
    # near of it.
    way_m: float = 0.005
    body_way_m: float = 0.01  # the same, between two searches for the body
    # The same for a fast limb, the 95th percentile of the body's vertices, which cloth must not be
    # passed by before it is found.
    limb_way_m: float = 0.04
    # searches_min, searches_max: such searches in a frame.
    searches_min: int = 4
    searches_max: int = 6
    reach_m: float = 0.045  # how far from the body its nearest point is looked for
    home_reach_m: float = 0.012  # how far from the limb that cloth lies on it touches no other
    # How far from itself the body may be where sheets of cloth share the room.
    clearance_m: float = 0.04
    # How far cloth slides over the body before that point is looked for again.
    slack_m: float = 0.002
    margin_m: float = 0.01  # how far from cloth other cloth is looked for
    self_gap_m: float = 0.005  # distance between parts of a garment
    # Of how far apart parts of a garment are at rest, how far from each other they are looked for.
    rest_share: float = 0.9
    part_sweeps: int = 3  # of keeping cloth apart at the end of a small step
    # Where a frame has to be gone through again: such sweeps, and small steps between searches.
    careful_sweeps: int = 10
    careful_steps: int = 2
    # How far from a vertex of the body cloth that covers it is looked for.
    cover_margin_m: float = 0.012
    cover_gap_m: float = 0.002  # how far above it that cloth is held
    # Of the springs in a small step; in each, what share they go of the way to where they are
    # content. The later go beyond, for what other springs take back.
    sweeps: tuple[float, ...] = (1.0, 1.2, 1.4)
    # Coefficient of all cloth on the body during the transition; later it is each fabric's own.
    lead_friction: float = 0.1
    # Share of its speed that cloth loses in a second of the transition, above what the air takes.
    lead_drag_1_s: float = 10.0
    # How fast contacts take away depth that was there before a small step.
    release_m_s: float = 0.567
    # How fast cloth may slip past the body and still be held, however light the contact is.
    stick_m_s: float = 0.0378
    untangle_rounds: int = 100  # of moving what passes through cloth at the end of a frame
    untangle_m_s: float = 0.945  # how fast cloth that passes through cloth is moved, at most
    pin_pull: float = 0.3  # share of the way to where it is held that a pin goes in a small step


class MovingCloth:
    """The garments of an outfit on their way through an attempt.

    Args:
        garments: from inner to outer.
        body: what they collide with.
        attempt: how finely, and how far from the body.
        settings: of the method.
        device: Warp's, that the work is done on.
        parallel: whether constraints of a colour act at once, and all contacts of a kind, as they
            do on a GPU; if not, all act in turn.
    """

    def __init__(
        self,
        garments: Sequence[ClothGarment],
        body: MovingBody,
        attempt: Attempt,
        settings: XpbdSettings,
        *,
        device: str = "cpu",
        parallel: bool = False,
    ) -> None:
        self._garments, self._body, self._settings = garments, body, settings
        self._gap_m, self._lead = attempt.gap_m, attempt.lead_frames
        self._steps = round(attempt.steps * settings.steps_per_step)
        self._step_s = 1 / FPS / self._steps
        self._step_ways_m = settings.release_m_s * self._step_s, settings.stick_m_s * self._step_s
        self._device, self._parallel = wp.get_device(device), parallel
        with wp.ScopedDevice(self._device):
            self._place_system()

    def _place_system(self) -> None:
        """Put the system and what it may touch on the device."""
        garments = self._garments
        self._width = 1 if self._parallel else LANES
        system = self._system = join_garments(garments, self._width)
        self._place = _vectors(system.vertices)
        weighed = np.column_stack([system.vertices, system.inverse_masses])
        self._weighed = wp.array(weighed.astype(np.float32), dtype=wp.vec4)
        self._before, self._speed, self._way = (wp.zeros_like(self._place) for _ in range(3))
        self._clock, self._friction = _numbers(np.zeros(2)), _numbers(system.skin_friction)
        self._keep = _numbers(np.zeros(len(system.vertices)))
        self._tick = record(tick, 1, [self._steps], [wp.zeros(1, dtype=int), self._clock])
        self._tick.launch()
        self._strain = _numbers(np.zeros(len(system.vertices)))
        self._last = wp.clone(self._place)  # a frame ago
        self._published = wp.clone(self._place)
        self._carry = _vectors(np.zeros((1, 3)))
        self._pin_start, self._pin_end = (_vectors(self._pins(0)) for _ in range(2))
        self._floor_m = wp.zeros(1, dtype=wp.vec2)  # at both ends of the frame
        self._surface = BodySurface(
            self._body, [g.vertices for g in garments], parallel=self._parallel
        )
        layers = wp.array(system.layers, dtype=int)
        triangles = wp.array(system.triangles, dtype=wp.vec3i)
        halves = 2 if all(g.faces.shape[1] == 4 for g in garments) else 1
        self._near = NearTriangles(
            wp.clone(self._place), triangles, layers, halves, parallel=self._parallel
        )
        self._covered = CoveredVertices(self._body, self._near, parallel=self._parallel)
        self._near_edges = NearEdges(self._near, system.vertices, parallel=self._parallel)
        self._crossed = CrossedTriangles(self._near_edges.edges, triangles)
        springs = system.springs
        self._measure = record(
            measure_strain,
            len(springs.pairs),
            [wp.array(springs.pairs, dtype=wp.vec2i), _numbers(springs.lengths_m), self._place],
            [self._strain],
        )
        self._contacts = self._record_contacts(triangles, layers)
        self._arrange()
        # What a frame changes, and how it was when the frame began.
        self._state = [self._place, self._speed, *self._elastic, *self._surface.anchors]
        self._kept = [wp.clone(array) for array in self._state]
        self._crossings = Crossings([g.vertices for g in garments], [g.faces for g in garments])
        self._frame = 0
        self._crossing = self._look()
        self._crossed.take(self._crossing)

    def _arrange(self) -> None:
        """Set what a small step does, and replay what is always the same in as few calls as can be.

        Contacts always are on a GPU, which goes through all vertices; a processor leaves out those
        that are near to nothing.
        """
        contacts, parts = self._launches(self._contacts), self._launches(self._part)
        first, touch, last = self._record_first(), self._record_touch(), self._record_last()
        # Searches themselves are not kept: they hold this object, which would outlive its sample.
        self._finds: list[Replay] = []
        approach = [contact.launch for contact in self._approach]
        sweeps = self._settings.part_sweeps
        keep_apart = [self._stay.launch, *parts]
        self._keep_apart = Sweeps(keep_apart, self._parted, sweeps)
        self._solve: list[Callable[[], None]] = [
            *approach,
            Replay(first),
            *contacts,
            Replay(touch),
            self._keep_apart,
            Replay(last),
        ]
        if self._device.is_cuda:
            self._finds = [Replay([find]) for find in self._searches]
            step = [*approach, *first, *contacts, *touch, *sweeps * keep_apart, *last]
            self._solve = [Replay(step)]

    def _launches(self, contacts: Sequence[BusyLaunch]) -> list[Callable[[], None]]:
        """What launches contacts, each with its moves where they act at once."""
        launches = [contact.launch for contact in contacts]
        if not self._parallel:
            return launches
        state = [self._before, self._place]
        moves = record(make_all_moves, len(self._place), [self._moves], state)
        return [part for launch in launches for part in (launch, moves.launch)]

    @property
    def _searches(self) -> list[Callable[[], None]]:
        """For the body, for cloth, and what is searched for once in a frame."""
        return [self._find_body, self._find_cloth, self._find_once]

    def _record_first(self) -> list[Callable[[], None]]:
        """Record what a small step does before contacts."""
        system, settings, weighed = self._system, self._settings, self._weighed
        launches = [
            record(
                predict,
                len(self._place),
                [self._keep, self._carry, self._step_s],
                [self._speed, self._way, self._before, self._place, weighed],
            ),
            record(
                hold,
                len(system.pinned),
                [
                    wp.array(system.pinned, dtype=int),
                    _numbers(settings.pin_pull * system.pin_weights),
                ],
                [self._pin_start, self._pin_end, self._clock, weighed],
            ),
            *self._record_elasticity(),
            record(take_places, len(self._place), [weighed], [self._place]),
        ]
        return [launch.launch for launch in launches if launch is not None]

    def _record_touch(self) -> list[Callable[[], None]]:
        """Record what it does after contacts with cloth, and while cloth is kept apart."""
        surface, state = self._surface, [self._before, self._place]
        touching = self._gap_m, *self._step_ways_m, self._friction
        planes = [surface.planes, self._clock]
        self._stay = record(stay_off_body, len(self._place), planes, state)
        launches = [
            record(
                touch_floor,
                0 if self._body.floor_m is None else len(self._place),
                [self._floor_m, self._clock, self._carry, *touching],
                state,
            ),
            record(
                touch_body,
                len(self._place),
                planes,
                [self._carry, *touching, *state],
            ),
        ]
        return [launch.launch for launch in launches if launch is not None]

    def _record_last(self) -> list[Callable[[], None]]:
        """Record what it does at the end; the clock then shows the next step."""
        state = [self._before, self._place]
        take = record(
            take_speed, len(self._place), [self._way, *state, self._step_s], [self._speed]
        )
        return [take.launch, self._tick.launch]

    def _record_elasticity(self) -> list[wp.Launch | None]:
        """Record the cloth's own resistance."""
        system, sweeps = self._system, self._settings.sweeps
        springs, hinges = system.springs, system.hinges
        number, index = (float, int) if self._parallel else (LaneFloats, LaneInts)
        pull = pull_springs if self._parallel else pull_springs_in_lanes
        turn = turn_hinges if self._parallel else turn_hinges_in_lanes

        def laid(values: np.ndarray, lanes: np.ndarray, dtype: type) -> wp.array:
            rows = lay_in_lanes(values, lanes)
            return wp.array(rows[..., 0] if self._parallel else rows, dtype=dtype)

        def numbers(values: np.ndarray, lanes: np.ndarray) -> wp.array:
            return laid(values.astype(np.float32), lanes, number)

        lanes, ways = system.spring_lanes, np.diff(system.vertices[springs.pairs], axis=1)[:, 0]
        pulling = [
            laid(springs.pairs, lanes, index),
            numbers(spring_numbers(springs, system.inverse_masses, self._step_s), lanes),
        ]
        pulled = [
            wp.zeros(len(lanes), dtype=number),
            numbers(np.linalg.norm(ways, axis=1)[:, None], lanes).flatten(),
            self._weighed,
        ]
        bent = system.hinge_lanes
        turning = [
            laid(hinges.vertices, bent, index),
            numbers(hinges.weights, bent),
            numbers(hinge_numbers(hinges, system.inverse_masses, self._step_s), bent),
        ]
        turned = [numbers(hinges.lengths_m[:, None], bent).flatten(), self._weighed]
        self._elastic = [*pulled[:-1], *turned]
        last = len(sweeps) - 1
        return [
            *(
                record(pull, count, [*pulling, first, k == 0, k == last, share], pulled)
                for k, share in enumerate(sweeps)
                for first, count in self._at_once(system.spring_rows)
            ),
            *(
                record(turn, count, [*turning, first], turned)
                for first, count in self._at_once(system.hinge_rows)
            ),
        ]

    def _at_once(self, rows: np.ndarray) -> list[tuple[int, int]]:
        """First rows, and how many, of the constraints that a launch solves: a colour, or all."""
        if self._parallel:
            return list(zip(rows[:-1].tolist(), np.diff(rows).tolist(), strict=True))
        return [(0, int(rows[-1]))]

    def _record_contacts(self, triangles: wp.array, layers: wp.array) -> list[BusyLaunch]:
        """Record what pushes cloth off the body and other cloth, but for the body's own surface."""
        system, settings, clearance = self._system, self._settings, self._surface.planes.clearance
        mass = _numbers(system.inverse_masses)
        moves = self._moves = make_moves(len(self._place) if self._parallel else 0)
        state = [moves, self._before, self._place]
        release_m, stick_m = self._step_ways_m
        gaps = settings.self_gap_m, self._gap_m
        near, near_edges = self._near, self._near_edges
        opposite = wp.array(opposite_vertices(system.triangles), dtype=wp.vec2i)
        stepping = [clearance, self._clock, self._steps, self._step_s, *gaps, self._speed]
        # Before anything moves: from where it starts, nothing passes through.
        self._approach = [
            BusyLaunch(
                approach_triangles,
                near.near.count,
                [near.near, triangles, layers, *stepping],
                [self._place, near.meetings],
            ),
            BusyLaunch(
                approach_edges,
                near_edges.near.count,
                [near_edges.near, near_edges.edges, layers, *stepping],
                [self._place, near_edges.meetings],
            ),
        ]
        self._parted = wp.zeros(1, dtype=int)
        apart = [*state, self._parted]
        self._part = [
            BusyLaunch(
                part_edges,
                near_edges.near.count,
                [near_edges.meetings, near_edges.edges],
                apart,
            ),
            BusyLaunch(part_triangles, near.near.count, [near.meetings, triangles], apart),
        ]
        covered, crossed = self._covered, self._crossed
        self._untangle, self._pull = (
            BusyLaunch(
                untangle,
                crossed.count,
                [crossed.count, crossed.crossed, near_edges.edges, opposite, triangles, mass],
                [settings.untangle_m_s * self._step_s, seen, *state],
            )
            for seen in (self._place, self._published)
        )
        return [
            BusyLaunch(
                push_off_body_vertices,
                covered.count,
                [
                    *(covered.count, covered.covers, covered.from_place, covered.to_place),
                    *(covered.up, triangles, mass, self._clock),
                ],
                [
                    *(self._carry, settings.cover_gap_m, settings.cover_margin_m),
                    *(release_m, stick_m, self._friction, *state),
                ],
            ),
            BusyLaunch(
                touch_cloth,
                near.near.count,
                [near.meetings, triangles, mass],
                [release_m, _numbers(system.self_friction), *state],
            ),
            BusyLaunch(
                touch_edges,
                near_edges.near.count,
                [near_edges.meetings, near_edges.edges, mass],
                [release_m, *state],
            ),
            self._untangle,
        ]

    def _pins(self, frame: int) -> np.ndarray:
        return np.concatenate([g.pins.positions(frame) for g in self._garments])

    def start(self, frame: int) -> None:
        """Set out from the frame before to `frame`; a GPU goes on while this returns."""
        with wp.ScopedDevice(self._device):
            self._frame = frame
            limb_way_m = self._begin(frame)
            for kept, array in zip(self._kept, self._state, strict=True):
                wp.copy(kept, array)
            self._body_every, cloth_every = self._search_every(limb_way_m)
            self._step(self._body_every, cloth_every)

    def arrive(self) -> list[np.ndarray]:
        """Vertices (V, 3) of each garment in the frame that was set out for.

        What passes through is pulled apart. A frame in which more is left than in the one before is
        gone through again, with so many searches that nothing which comes near is overlooked.
        """
        with wp.ScopedDevice(self._device):
            crossing = self._pull_apart(self._look())
            if len(crossing) > len(self._crossing):
                for kept, array in zip(self._kept, self._state, strict=True):
                    wp.copy(array, kept)
                self._crossed.take(self._crossing)
                self._keep_apart.most = self._settings.careful_sweeps
                self._step(self._body_every, self._settings.careful_steps)
                self._keep_apart.most = self._settings.part_sweeps
                crossing = self._pull_apart(self._look())
        self._crossing = crossing
        return self._system.split(self._place.numpy().copy())

    def _pull_apart(self, crossing: np.ndarray) -> np.ndarray:
        """Move edges and triangles (n, 2) apart; returns what still passes through in the end."""
        self._crossed.take(crossing)
        for _ in range(self._settings.untangle_rounds):
            if not len(crossing):
                break
            self._pull.find()
            for part in self._launches([self._pull]):
                part()
            crossing = self._look()
            self._crossed.take(crossing)
        return crossing

    def _look(self) -> np.ndarray:
        """Edges that pass through triangles (n, 2), of the cloth as it will be published."""
        published = self._body.publish(self._place.numpy(), self._frame)
        self._published.assign(published)
        return self._crossings.pairs_through([published])

    def _step(self, body_every: int, cloth_every: int) -> None:
        """Take the small steps of a frame, and search every so many for the body and for cloth."""
        self._cloth_every = cloth_every
        find_body, find_cloth, find_once = self._finds or self._searches
        for step in range(self._steps):
            if step % body_every == 0:
                find_body()
            if step % cloth_every == 0:
                find_cloth()
            if step == 0:
                find_once()
            if step % cloth_every == 0:
                for contact in [*self._approach, *self._contacts, *self._part]:
                    contact.find()
            for part in self._solve:
                part()

    def _search_every(self, limb_way_m: float) -> tuple[int, int]:
        """Small steps between two searches for the body, and for cloth.

        In these, cloth goes past cloth by `body_way_m` or `way_m` if it is as fast as in the frame
        before. Nor do the body's limbs move by more than `limb_way_m` between two for the body.
        """
        settings = self._settings
        way_m = self._near.relative_way_m(self._last, self._place)
        wp.copy(self._last, self._place)
        body_ways = max(way_m / settings.body_way_m, limb_way_m / settings.limb_way_m)
        ways = [body_ways, way_m / settings.way_m]
        searches = np.clip(np.ceil(ways), settings.searches_min, settings.searches_max)
        body_every, cloth_every = np.ceil(self._steps / searches).astype(int).tolist()
        self._drift = self._speed.numpy().mean(axis=0)
        return body_every, cloth_every

    def _find_body(self) -> None:
        """Find where the cloth is nearest to the body."""
        settings = self._settings
        self._strain.zero_()
        self._measure.launch()
        self._surface.find_anchors(
            self._place,
            self._strain,
            self._clock,
            home_reach_m=settings.home_reach_m,
            reach_m=settings.reach_m,
            gap_m=self._gap_m,
            slack_m=settings.slack_m,
        )

    def _find_cloth(self) -> None:
        """Find what the cloth is near to of itself."""
        settings, near = self._settings, self._near
        near.find(
            self._place,
            self._speed,
            self._drift,
            time_s=self._cloth_every * self._step_s,
            margin_m=settings.margin_m,
            rest_share=settings.rest_share,
        )
        self._near_edges.find(margin_m=settings.margin_m, rest_share=settings.rest_share)
        self._crossed.free(self._place, near.near, self._near_edges.near)

    def _find_once(self) -> None:
        """Find what is found once in a frame: the body's room, and its vertices under cloth."""
        self._surface.find_clearance(self._settings.clearance_m)
        margin_m = self._settings.cover_margin_m
        self._covered.find(self._place, self._surface.ends, margin_m=margin_m)

    def _begin(self, frame: int) -> float:
        """Take body, pins and, in the transition, cloth to the frame.

        Returns how far the body's fast limbs go past its middle, in metres.
        """
        now = self._body.frame(frame)
        self._surface.move_to(now)
        if self._body.floor_m is not None:
            self._floor_m.assign(self._body.floor_m[None, frame - 1 : frame + 1])
        self._pin_start.assign(self._pin_end)
        self._pin_end.assign(self._pins(frame).astype(np.float32))
        moved = now.astype(np.float64) - self._body.frame(frame - 1)
        way = moved.mean(axis=0)
        leading = frame <= self._lead
        if frame == self._lead + 1:
            wp.launch(
                add_speed,
                dim=len(self._speed),
                inputs=[wp.vec3(*(way * FPS))],
                outputs=[self._speed],
            )
        self._carry.assign((leading * way / self._steps)[None].astype(np.float32))
        if leading:
            self._friction.fill_(self._settings.lead_friction)
        else:
            self._friction.assign(self._system.skin_friction.astype(np.float32))
        drag_1_s = self._system.drag_1_s + leading * self._settings.lead_drag_1_s
        self._keep.assign(np.exp(-drag_1_s * self._step_s).astype(np.float32))
        return float(np.percentile(np.linalg.norm(moved - way, axis=1), 95))


def _vectors(rows: np.ndarray) -> wp.array:
    return wp.array(np.ascontiguousarray(rows, dtype=np.float32), dtype=wp.vec3)


def _numbers(values: np.ndarray) -> wp.array:
    return wp.array(np.ascontiguousarray(values, dtype=np.float32), dtype=float)
