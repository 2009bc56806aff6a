"""The master's cycle: sense, decide, act."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from teleop_rt.config.master import MasterConfig
from teleop_rt.config.rig import Limits
from teleop_rt.contact.effect import Effect
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.codec import motion_body
from teleop_rt.link.messages import Kind, StateMessage
from teleop_rt.master.build import make_port
from teleop_rt.master.coupling import Coupling
from teleop_rt.master.device import HeldDevice
from teleop_rt.master.engagement import DECLUTCHED, ENGAGED, FROZEN, WAITING, Engagement
from teleop_rt.master.handle_faults import NO_FAULT, OSCILLATION, HandleFault
from teleop_rt.master.operators import Operator
from teleop_rt.master.parts import (
    make_adoption,
    make_aim,
    make_brakes,
    make_intake,
    make_observer,
    make_registration,
    make_screening,
    range_of,
)
from teleop_rt.master.passivity import Port
from teleop_rt.master.rendered_effects import RenderedEffects
from teleop_rt.master.rows import record
from teleop_rt.master.shaking import ShakeGuard
from teleop_rt.master.stalled_force import StalledForce
from teleop_rt.master.wall_limiter import RenderedBound, WallLimiter
from teleop_rt.master.walls import NO_WALL
from teleop_rt.realtime.row import NamedRow
from teleop_rt.signals import MASTER

# By this name a tick finds it at once.
_MOTION = Kind.MOTION


class Master:
    """Renders the newest wall against the operator's motion of the same tick.

    `cycle()` is one tick; `row` is laid out by `signals.MASTER`. Units are the rig's. Walls,
    offset and target are the slave's; position, velocity and force are the hand's, which is
    scaled: it moves the slave by `position_scale` times its own motion and feels `force_scale`
    times the wall's force; `hand` is its position so scaled. Forces and energies of `adoption` are
    before that scaling, and `energy_scale` is the hand's energy per the wall's. With a `coupling`
    no wall is rendered: it says the force, and the observer only observes.
    """

    def __init__(
        self,
        config: MasterConfig,
        limits: Limits,
        period_ns: int,
        operator: Operator,
        endpoint: Endpoint,
        now_ns: Callable[[], int],
        coupling: Coupling | None = None,
        effects: Sequence[Effect] = (),
        port: Port | None = None,
    ) -> None:
        force_max = config.force_max / config.force_scale
        self._dt_s = dt_s = period_ns * 1e-9
        self._operator = operator
        self._device = operator if isinstance(operator, HeldDevice) else None
        self.endpoint, self._now_ns = endpoint, now_ns
        self._coupling = coupling
        self._position_scale, self.force_scale = config.position_scale, config.force_scale
        self._force_max = config.force_max
        self._stall = StalledForce(config.force_step)
        self._surface_W = 1e-3 * config.surface_power_mW
        self.energy_scale = config.force_scale / config.position_scale
        self.adoption = make_adoption(config)
        self.registration = make_registration(config, limits)
        self.aim = make_aim(config, limits, dt_s)
        self.screening = make_screening(limits)
        self.engagement = Engagement(config)
        port = port or make_port(config, dt_s)
        self.limiter = WallLimiter(port, force_max, limits.velocity_max)
        self.observer = make_observer(config, port, dt_s, damps=coupling is None)
        self.shaking = ShakeGuard(dt_s, port.damping)
        self.leash, self.ends = make_brakes(config, self._device, self.limiter.grip, dt_s)
        self.effects = RenderedEffects(effects, range_of(limits), limits.velocity_max)
        self.intake = make_intake(
            config, limits, self.adoption, self.registration, self.limiter, self.screening,
            self.effects,
        )  # fmt: skip
        self.row = NamedRow(MASTER).values
        self.reset()

    def reset(self) -> None:
        """Go back to the state before the first tick, with the operator at the start."""
        self.adoption.reset()
        self.registration.reset()
        self.screening.reset()
        self.engagement.reset()
        self.limiter.reset()
        self.observer.reset()
        self.shaking.reset()
        self.leash.reset()
        self.ends.reset()
        self._operator.reset()
        self.tick = 0
        self.intake.reset()
        self.force = self.position = self.velocity = self._moving = self.target = self.hand = 0.0
        self._one_way_s = self._surface_J = 0.0
        self.aim.reset()
        self._stall.reset()
        self._started_ns = -1
        self._waits_at = math.inf
        self.slave: StateMessage | None = None
        self.row[:] = NamedRow(MASTER).values
        self._forget()

    def cycle(self, skipped: int = 0, *, stalled: bool = False) -> None:
        """Run one tick; `skipped` ticks were missed before it, `stalled` where these were long."""
        self.tick += 1 + skipped
        if stalled:
            self._stall.begin()
        now_ns = self._now_ns()
        self._sense(now_ns)
        self._decide(now_ns)
        self._act(now_ns)

    def take_ahead(self) -> None:
        """Take in waiting packets ahead of a tick, and make the wall of a model among them."""
        endpoint = self.endpoint
        endpoint.take_ahead()
        if self._coupling is None and self.engagement.state is ENGAGED:
            self.intake.prepare(endpoint.model)

    def _sense(self, now_ns: int) -> None:
        """Take in the operator's motion and the news of this tick."""
        endpoint = self.endpoint
        endpoint.poll()
        self.silence_ns = endpoint.silence_ns(now_ns)
        self._fresh = False
        state = endpoint.state
        if state is None:
            self.slave = None
        elif endpoint.fresh_state and self.screening.accepts(state):
            self.slave, self._fresh = state, True
        if self._started_ns < 0 and self.engagement.ever_engaged:
            self._started_ns = now_ns
        since_s = (now_ns - self._started_ns) * 1e-9 if self._started_ns >= 0 else 0.0
        self.position, self._moving = self._operator.update(since_s, self.force)
        self.velocity = 0.0 if self._started_ns < 0 else self._moving
        self.hand = self._position_scale * self.position

    def _decide(self, now_ns: int) -> None:
        """Decide on link state, wall, offset and force."""
        endpoint, before = self.endpoint, self.engagement.state
        round_trip_ns = max(0, endpoint.statistics.round_trip_ns)
        self._one_way_s = 0.5e-9 * round_trip_ns
        if before is WAITING and self.slave is not None:
            self.registration.index(self.hand, self.slave.position)
        self.engagement.update(
            now_ns, self.slave, self.silence_ns, round_trip_ns, endpoint.session_id
        )
        state = self.engagement.state
        if state is WAITING or state is DECLUTCHED:
            endpoint.clock.release()
        elif before is WAITING:
            endpoint.fix_clock()
        if before is DECLUTCHED and state is WAITING:
            self._forget()
        if state is ENGAGED and self._coupling is None:
            fresh = self.slave if self._fresh else None
            self.intake.take(endpoint.model, fresh, self.hand, self._one_way_s, 1e-9 * now_ns)
            self._relax()
        force = (self._wanted_force() + self._brake()) * self.force_scale
        force *= self.engagement.fade(now_ns)
        force = max(-self._force_max, min(self._force_max, force))
        self.force = self._guarded(self._stall.without_a_step(force, self.force))

    def _guarded(self, force: float) -> float:
        """Return the force as energy, swings and the device's own safety chain let it through."""
        stored_J = math.inf
        if self._coupling is None:
            stored_J = self.energy_scale * max(0.0, self.adoption.stored_J)
        room = self.force_scale * self._position_scale * self.limiter.damping_room
        surface_J = self.energy_scale * self._surface_J
        stepped_J = self.energy_scale * self.adoption.stepped_J
        force = self.observer.update(
            self.position, self.velocity, force, stored_J, room, surface_J, stepped_J
        )
        if self._device is None:
            return max(-self._force_max, min(self._force_max, force))
        shaking = self.shaking
        if shaking.update(self.position, self.velocity, self.force, self.observer.made_J):
            self.limiter.trust(shaking.trust)
            self.intake.render_anew(self.hand, self._one_way_s)
        self.observer.bounded = shaking.bounding
        if shaking.lets_go:
            self._device.watch.let_go(OSCILLATION)
        if self._device.watch.fault is not NO_FAULT:
            return 0.0
        return max(-self._force_max, min(self._force_max, force))

    def _brake(self) -> float:
        """Return the force of the ends of travel, and the leash's until the first touch is known.

        Until the slave follows, the hand leads it by its motion since the slave began to wait.
        """
        slave, hand = self.slave, self.hand
        if self._device is None or self._coupling is not None:
            return 0.0
        velocity = self._position_scale * self._moving
        force = self.ends.brake(hand, velocity, touches=self._touches)
        leash = self.leash.update(hand, self._lead(hand, slave), velocity)
        return max(force, leash) if force > 0.0 else force + leash

    def _lead(self, hand: float, slave: StateMessage | None) -> float:
        """Return by how much the hand leads the slave; 0 once the first touch is known."""
        if slave is None or self.engagement.state is WAITING:
            self._waits_at = min(self._waits_at, hand)
            return hand - self._waits_at
        self._waits_at = math.inf
        return 0.0 if self.adoption.newest is not NO_WALL else self.x - slave.position

    def _wanted_force(self) -> float:
        """Return the force of the walls, or of the coupling, before scaling and limits."""
        x, velocity, dt_s = self.x, self._position_scale * self.velocity, self._dt_s
        if self._coupling is None:
            adoption = self.adoption
            self.effects.advance(x, adoption.newest.surface, velocity, dt_s)
            self._surface_J = adoption.move(x, dt_s, self._surface_W / self.energy_scale)
            return adoption.update(x, velocity, dt_s)
        if self.slave is None or self.engagement.state is WAITING:
            return 0.0
        return self._coupling.update(x, velocity, self.slave, dt_s)

    def _act(self, now_ns: int) -> None:
        """Push the hand, send the motion and record the tick."""
        if self._device is not None:
            self._device.push(self.force)
        wall, state = self.adoption.newest, self.engagement.state
        frozen, moves = state is FROZEN, self._position_scale * self.velocity
        self.target = self.aim.update(
            self.hand, moves * self._dt_s, self.registration.offset, state, wall
        )
        known = wall is not NO_WALL
        asks = self.engagement.asks(self.slave, self.silence_ns)
        faulted = self.fault is not NO_FAULT
        body = motion_body(
            self.target,
            0.0 if frozen else moves,
            wall.surface if known else 0.0,
            self.force / self.force_scale,
            0.0 if self._coupling is None else self._coupling.energy_J,
            self.intake.acknowledged,
            asks and not faulted,
            known,
            self.intake.provisional,
            faulted,
        )
        self.endpoint.send_body(_MOTION, body)
        record(self, now_ns)

    @property
    def x(self) -> float:
        """The hand's position in the slave's coordinates, scaled x_m - o."""
        return self.hand - self.registration.offset

    @property
    def fault(self) -> HandleFault:
        """Why the operator's device was let go."""
        return NO_FAULT if self._device is None else self._device.watch.fault

    @property
    def unsafe(self) -> list[str]:
        """Protections that the operator's device lacks, in sentences."""
        return [] if self._device is None else self._device.watch.unsafe

    @property
    def rendered_bound(self) -> RenderedBound:
        """The newest wall, true and as the passivity bound lets it be rendered."""
        return self.limiter.rendered_bound

    def _forget(self) -> None:
        """Forget the wall and the agreement with the slave."""
        self.adoption.drop()
        self.effects.reset()
        if self._coupling is not None:
            self._coupling.reset()
        self.intake.forget()
        self.aim.forget()

    @property
    def _touches(self) -> bool:
        """Whether the hand is inside a rendered wall, or about to be."""
        x, adoption = self.x, self.adoption
        return adoption.holds(x) or adoption.newest.holds(x)

    def _relax(self) -> None:
        """Let the offset take up motion towards an end of travel, and vanish elsewhere."""
        hand, touches = self.hand, self._touches
        self.registration.offset += self.ends.withhold(hand, touches=touches)
        if not touches and not self.ends.beyond(hand):
            self.registration.relax(hand, self.adoption.newest, self._dt_s)
