"""The agent's body: an upright capsule on two slides that MuJoCo moves, with a camera that pans and tilts on top.

The capsule is driven by position servos whose set point travels along the commanded stride; furniture and walls stop
it, because the servos are weaker than the contacts, and let it slide along them, because contacts have no friction. The
body does not turn: it is round and drives in any direction, so its heading is simply the pan of its camera. Pan and
tilt are kinematic (set outright): real heads turn much faster than bodies walk, and nothing they could touch is up
there.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from labeling.core.geometry import flip_camera_axes
from sbm_gym.robot.angles import wrap
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION

AGENT_BODY = "agent"
CAMERA = "agent_camera"
SLIDE_X, SLIDE_Y, PAN, TILT = "agent_x", "agent_y", "agent_pan", "agent_tilt"

CONTACT_MARGIN_M = 0.01
"""Contacts push from this distance on, so that the soft contacts of MuJoCo yield before anything overlaps."""
SUBSTEP_S = 0.01
_MASS_KG = 20.0
_SERVO_RATE_RAD_S = 25.0
"""Natural frequency of the critically damped servos: they trail the set point by 2/25 s."""
_MAX_FORCE_N = 600.0
"""Limits the push against an obstacle to 30 m/s^2, which a contact answers with a fraction of a millimetre."""
_SETTLE_SUBSTEPS = 40
_ARRIVED_M = 2e-4
_SLACK_M = 0.5
"""Obstacles this much farther away than a move is long are out of its reach for certain."""
_BLOCKED_M = 0.02
"""A move that ends this far from its goal while touching something has collided."""
_IDENTITY = np.eye(4)


@dataclass(frozen=True)
class BodyConfig:
    """Size and reach of the agent's body."""

    radius_m: float = 0.18
    """Radius of the capsule, metres; a vacuum robot's."""
    camera_height_m: float = 1.5
    """Height of the camera above the floor, metres; the thesis' indoor agent (A.2.2, published code)."""
    max_tilt_rad: float = 1.2
    """The camera tilts between this far down and this far up."""
    speed_m_s: float = 1.25
    """Speed of the set point: a substep then advances it by 12.5 mm, far less than walls and the body are thick."""


def add_agent(spec: mujoco.MjSpec, config: BodyConfig) -> None:
    """Adds the agent to a world that has not been compiled yet.

    Args:
        spec: the world; its time step is set to that of the agent's servos.
        config: the body.

    Raises:
        ValueError: if the world already has an agent.
    """
    if any(body.name == AGENT_BODY for body in spec.bodies):
        raise ValueError(f"the world already has a body named {AGENT_BODY!r}; add the agent once")
    spec.option.timestep = SUBSTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    body = spec.worldbody.add_body(name=AGENT_BODY, pos=[0.0, 0.0, 0.0])
    for name, axis in ((SLIDE_X, [1.0, 0.0, 0.0]), (SLIDE_Y, [0.0, 1.0, 0.0])):
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    floor_gap_m = 0.05
    half_length_m = 0.5 * (config.camera_height_m - floor_gap_m) - config.radius_m
    body.add_geom(
        name="agent_torso",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[config.radius_m, half_length_m, 0.0],
        pos=[0.0, 0.0, 0.5 * (config.camera_height_m + floor_gap_m)],
        group=GEOM_GROUP_COLLISION,
        mass=_MASS_KG,
        contype=1,
        conaffinity=1,
        condim=1,
        # The agent's contact parameters win over those of the furniture: as stiff as the substep allows, no friction.
        priority=1,
        margin=CONTACT_MARGIN_M,
        solref=[2.0 * SUBSTEP_S, 1.0],
        solimp=[0.99, 0.999, 0.001, 0.5, 2.0],
        rgba=[0.2, 0.2, 0.2, 1.0],
    )
    _add_head(body, config)
    gain = _MASS_KG * _SERVO_RATE_RAD_S**2
    damping = 2.0 * _MASS_KG * _SERVO_RATE_RAD_S
    for name in (SLIDE_X, SLIDE_Y):
        servo = spec.add_actuator(
            name=f"{name}_servo",
            target=name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            forcelimited=True,
            forcerange=[-_MAX_FORCE_N, _MAX_FORCE_N],
        )
        servo.gainprm[0] = gain
        servo.biasprm[1], servo.biasprm[2] = -gain, -damping


def _add_head(body: mujoco.MjsBody, config: BodyConfig) -> None:
    """The head: massive only for the sake of the solver, its centre of mass on both axes, so it never feels a force."""
    head = body.add_body(name="agent_head", pos=[0.0, 0.0, config.camera_height_m])
    head.add_joint(name=PAN, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
    # Positive tilt looks up: at pan 0 the camera looks along +X, so it turns about -Y.
    head.add_joint(name=TILT, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, -1.0, 0.0])
    head.explicitinertial = True
    head.mass, head.ipos, head.inertia = 0.5, [0.0, 0.0, 0.0], [0.01, 0.01, 0.01]
    # OpenGL camera axes: -Z forward along the body's +X, +X right along its -Y, +Y up.
    head.add_camera(name=CAMERA, pos=[0.0, 0.0, 0.0], quat=[0.5, 0.5, -0.5, -0.5], fovy=90.0)


class AgentBody:
    """Moves the agent of one compiled model and reads where it is."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, config: BodyConfig) -> None:
        """Looks up the agent that ``add_agent`` put into the model.

        Args:
            model: the compiled world.
            data: its state, which this object writes to.
            config: the body as it was given to ``add_agent``.
        """
        self.model, self.data = model, data
        self._qpos = {name: int(model.joint(name).qposadr[0]) for name in (SLIDE_X, SLIDE_Y, PAN, TILT)}
        self._xy = np.array([self._qpos[SLIDE_X], self._qpos[SLIDE_Y]])
        self._xy_dof = np.array([int(model.joint(name).dofadr[0]) for name in (SLIDE_X, SLIDE_Y)])
        self._servos = np.array([model.actuator(f"{name}_servo").id for name in (SLIDE_X, SLIDE_Y)])
        self._torso = int(model.geom("agent_torso").id)
        self._camera = int(model.camera(CAMERA).id)
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        bounded = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
        # The agent's own body and those with anything endless are never out of reach.
        always = np.append(model.geom_bodyid[solid & ~bounded], model.geom_bodyid[self._torso])
        self._obstacles = np.flatnonzero(solid & ~np.isin(model.geom_bodyid, always))
        self._obstacle_bodies = model.geom_bodyid[self._obstacles].copy()
        self._obstacle_radii_m = model.geom_rbound[self._obstacles] + model.geom_rbound[self._torso]
        self._max_tilt_rad, self._speed_m_s = config.max_tilt_rad, config.speed_m_s

    @property
    def position_m(self) -> Float[np.ndarray, "2"]:
        """Where the body stands on the floor, world axes."""
        return self.data.qpos[self._xy].copy()

    @property
    def yaw_rad(self) -> float:
        """Heading, counter-clockwise from +X, in [-pi, pi)."""
        return float(self.data.qpos[self._qpos[PAN]])

    @property
    def tilt_rad(self) -> float:
        """Tilt of the camera, up is positive."""
        return float(self.data.qpos[self._qpos[TILT]])

    @property
    def camera_to_world(self) -> Float[np.ndarray, "4 4"]:
        """Pose of the camera, OpenCV axes."""
        opengl = _IDENTITY.copy()
        opengl[:3, :3] = self.data.cam_xmat[self._camera].reshape(3, 3)
        opengl[:3, 3] = self.data.cam_xpos[self._camera]
        return flip_camera_axes(opengl)

    def place(self, position_m: Float[np.ndarray, "2"], yaw_rad: float, tilt_rad: float) -> None:
        """Puts the agent somewhere at rest, as at the start of an episode."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self._xy] = position_m
        self.data.ctrl[self._servos] = position_m
        self._turn_head(yaw_rad, tilt_rad)
        mujoco.mj_forward(self.model, self.data)

    def look(self, yaw_rad: float, tilt_rad: float) -> None:
        """Turns the camera; the tilt is clipped to what the head can do."""
        self._turn_head(yaw_rad, tilt_rad)
        # Nothing on the head can be touched: where things are is all that changes.
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def _turn_head(self, yaw_rad: float, tilt_rad: float) -> None:
        self.data.qpos[self._qpos[PAN]] = wrap(yaw_rad)
        self.data.qpos[self._qpos[TILT]] = min(max(tilt_rad, -self._max_tilt_rad), self._max_tilt_rad)
        self.data.qvel[:] = 0.0

    def move(self, displacement_m: Float[np.ndarray, "2"], way_is_free: bool = False) -> bool:
        """Drives the body, as far as obstacles let it, and brings it to rest.

        Args:
            displacement_m: where to go from here, world axes.
            way_is_free: that a map shows nothing in the straight way there. The body is then set down at the goal
                without physics, which would bring it there too, to within its tolerance of arrival (a fraction of a
                millimetre); no simulated time passes. Where it would come within ``CONTACT_MARGIN_M`` of something at
                the goal the promise does not count.

        Returns:
            Whether an obstacle kept the body from where it was sent.
        """
        start = self.position_m
        goal = start + np.asarray(displacement_m, float)
        if way_is_free and self._set_down(goal):
            return False
        distance_m = float(np.linalg.norm(displacement_m))
        yaw_rad, tilt_rad = self.yaw_rad, self.tilt_rad
        self.data.qvel[:] = 0.0
        if distance_m > 0.0:
            travelling = int(np.ceil(distance_m / (self._speed_m_s * SUBSTEP_S)))
            with self._near_things_only(distance_m + _SLACK_M):
                model, data, ctrl = self.model, self.data, self.data.ctrl
                for set_point in start + (goal - start) * (np.arange(1, travelling + 1) / travelling)[:, None]:
                    ctrl[self._servos] = set_point
                    mujoco.mj_step(model, data)
                self._settle(goal)
        touching, end = self._touching(), self.position_m
        self.data.ctrl[self._servos] = end
        self._turn_head(yaw_rad, tilt_rad)
        mujoco.mj_forward(self.model, self.data)
        return touching and bool(np.linalg.norm(goal - end) > _BLOCKED_M)

    def _set_down(self, goal: Float[np.ndarray, "2"]) -> bool:
        """Puts the body at rest somewhere if it touches nothing there; else leaves it where it was."""
        start, guess = self.position_m, self.data.qacc_warmstart.copy()
        self.data.qpos[self._xy] = self.data.ctrl[self._servos] = goal
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        if not self._touching():
            return True
        # With the solver's first guess restored, physics goes on as if nothing had been tried.
        self.data.qpos[self._xy] = self.data.ctrl[self._servos] = start
        self.data.qacc_warmstart[:] = guess
        return False

    @contextmanager
    def _near_things_only(self, reach_m: float) -> Iterator[None]:
        """Has MuJoCo look for contacts with near obstacles only, which finds the same ones much sooner in a town, and
        leave alone what never moves (the world "sleeps"; driven bodies do not), whose place it knows already.
        """
        model = self.model
        x, y = (self.data.geom_xpos[self._obstacles, :2] - self.position_m).T
        is_near = x * x + y * y <= (reach_m + self._obstacle_radii_m) ** 2
        is_far = np.zeros(model.nbody, bool)
        is_far[self._obstacle_bodies] = True
        is_far[self._obstacle_bodies[is_near]] = False
        before = model.body_contype.copy(), model.body_conaffinity.copy()
        flags = model.opt.enableflags
        model.body_contype[is_far] = model.body_conaffinity[is_far] = 0
        model.opt.enableflags = flags | mujoco.mjtEnableBit.mjENBL_SLEEP
        try:
            yield
        finally:
            model.body_contype[:], model.body_conaffinity[:] = before
            model.opt.enableflags = flags

    def _settle(self, goal: Float[np.ndarray, "2"]) -> None:
        """Lets the servos finish; ends early when the body has arrived or rests against an obstacle."""
        qpos, qvel = self.data.qpos, self.data.qvel
        for _ in range(_SETTLE_SUBSTEPS):
            if math.hypot(*qvel[self._xy_dof].tolist()) < 1e-2 and (
                math.dist(goal.tolist(), qpos[self._xy].tolist()) < _ARRIVED_M or self._touching()
            ):
                return
            mujoco.mj_step(self.model, self.data)

    def _touching(self) -> bool:
        contacts = self.data.contact
        return bool(np.any(contacts.geom == self._torso)) if self.data.ncon else False
