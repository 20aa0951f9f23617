"""Physics profiles: named settings of the model and the integrator."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from sb3_piano.engine import mujoco
from sb3_piano.settings import refuse_unknown


@dataclass(frozen=True, kw_only=True)
class PhysicsProfile:
    """Timestep, integrator and simplifications of the simulation."""

    timestep: float
    """Length of a physics step, s."""
    integrator: mujoco.mjtIntegrator
    """MuJoCo's integrator. Runge-Kutta is unsupported, as the simulation splits steps in stages."""
    balanced_keys: bool = False
    """Balance a key's spring and its weight at angle 0, instead of pressing the key against a joint
    limit: 88 constraints fewer in every physics step. The spring is a little stiffer, so that
    holding a key fully down takes the same torque; touching it takes less."""
    key_rebound: float = 0.1
    """Largest angle past 0 to which a released balanced key may swing, rad; its joint limit is
    there. 0.1 is never reached. Near 0 the key comes to rest at once, like a key on its limit, but
    has no constraint at rest."""
    coupled_friction_only: bool = False
    """Keep dry friction only in the middle joints (J2) of the fingers, where one actuator bends J2
    and J1, and friction decides their shares. In other joints the servos overcome friction, and it
    costs a constraint for each joint."""
    playing_contacts_only: bool = False
    """Check only contacts that matter to playing: of fingertips and middle phalanges with the
    keyboard, and between the two hands. Fingers of one hand then do not collide."""
    capsule_forearms: bool = False
    """Replace each forearm's hull by a capsule, as MuJoCo Warp misses contacts of the hulls as
    shallow as 0.1 mm. Forearms collide only with each other."""


_REFERENCE = PhysicsProfile(timestep=0.005, integrator=mujoco.mjtIntegrator.mjINT_EULER)
_FAST = PhysicsProfile(
    timestep=0.01,
    integrator=mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    balanced_keys=True,
    coupled_friction_only=True,
    playing_contacts_only=True,
)
_FAITHFUL = dataclasses.replace(
    _REFERENCE, balanced_keys=True, key_rebound=0.002, coupled_friction_only=True
)

PHYSICS_PROFILES = {
    # The model of RoboPianist 1.0.10.
    "reference": _REFERENCE,
    # The same music at a third of the cost; docs/performance.md has the measurements.
    "fast": _FAST,
    # A fifth slower, with collisions between the fingers of a hand.
    "fast-contacts": dataclasses.replace(_FAST, playing_contacts_only=False),
    # 1.4 to 1.5 times as fast as the reference, with hardly any change for players.
    "faithful": _FAITHFUL,
    # For MuJoCo Warp, see docs/batch.md.
    "faithful-capsules": dataclasses.replace(_FAITHFUL, capsule_forearms=True),
    "fast-capsules": dataclasses.replace(_FAST, capsule_forearms=True),
}
"""The physics profiles by name."""


def physics_profile(name: str) -> PhysicsProfile:
    """Return the profile called ``name``.

    Raises:
        ConfigError: If no profile has this name.
    """
    refuse_unknown([name], PHYSICS_PROFILES, "physics profile")
    return PHYSICS_PROFILES[name]
