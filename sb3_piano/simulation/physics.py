"""Physics profiles: how the simulation is modelled and stepped, chosen by name."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from sb3_piano.engine import mujoco
from sb3_piano.exceptions import ConfigError, near_names


@dataclass(frozen=True, kw_only=True)
class PhysicsProfile:
    """Simplifications of the simulation, and its steps."""

    timestep: float
    """Length of a physics step in seconds."""
    integrator: mujoco.mjtIntegrator
    """MuJoCo's integrator. Runge-Kutta is unsupported: the env splits a step in two stages."""
    balanced_keys: bool = False
    """Let a key's spring hold it at angle 0 in balance with its weight, instead of pressing it
    against a joint limit: 88 constraints fewer in every physics step. The spring is a little
    stiffer, so that holding a key fully down takes the same torque; touching it takes less."""
    key_rebound: float = 0.1
    """Angle (rad) by which a balanced key that is released may swing past 0, where its joint limit
    is: 0.1 is never reached; next to 0 it comes to rest at once, as a key that lies on its limit
    does, while one at rest has no constraint."""
    coupled_friction_only: bool = False
    """Keep dry friction only in the middle joints (J2) of the fingers: one actuator bends J2 and J1
    together, and friction decides how they share the way. Elsewhere the servos overcome it, and it
    costs a constraint for each joint."""
    playing_contacts_only: bool = False
    """Look only for contacts that matter to playing: of fingertips and middle phalanges with the
    keyboard, and between the two hands. The fingers of one hand then pass through each other."""
    capsule_forearms: bool = False
    """Let a capsule stand for each forearm's hull, of which MuJoCo Warp finds no contact as shallow
    as 0.1 mm. Forearms touch nothing but each other."""


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
    # What RoboPianist 1.0.10 compiles to.
    "reference": _REFERENCE,
    # The same music at a third of the cost; docs/performance.md has the measurements.
    "fast": _FAST,
    # A fifth slower, for policies whose fingers would lean on each other, or get caught.
    "fast-contacts": dataclasses.replace(_FAST, playing_contacts_only=False),
    # 1.4 to 1.5 times as fast as the reference, and what plays there hardly notices.
    "faithful": _FAITHFUL,
    # For MuJoCo Warp, see docs/batch.md.
    "faithful-capsules": dataclasses.replace(_FAITHFUL, capsule_forearms=True),
    "fast-capsules": dataclasses.replace(_FAST, capsule_forearms=True),
}
"""The physics profiles by name."""


def physics_profile(name: str) -> PhysicsProfile:
    """Return the profile called ``name``.

    Raises:
        ConfigError: If there is none.
    """
    try:
        return PHYSICS_PROFILES[name]
    except (KeyError, TypeError):
        raise ConfigError(
            f"Unknown physics profile {name!r}: expected one of {sorted(PHYSICS_PROFILES)}."
            f"{near_names(str(name), PHYSICS_PROFILES)}"
        ) from None
