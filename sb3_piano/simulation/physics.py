"""Physics profiles: how the simulation is stepped, chosen by name."""

from __future__ import annotations

from dataclasses import dataclass

from sb3_piano.exceptions import ConfigError, near_names


@dataclass(frozen=True, kw_only=True)
class PhysicsProfile:
    """Options handed to MuJoCo; the names are those of MJCF's ``option`` element."""

    timestep: float
    """Length of a physics step in seconds."""
    integrator: str
    """MuJoCo's integrator. Runge-Kutta is unsupported: the env splits a step in two stages."""
    solver: str
    """Constraint solver."""
    cone: str
    """Friction cone."""
    iterations: int
    """Most iterations of the solver."""
    impratio: float
    """Ratio of frictional to normal constraint impedance."""


PHYSICS_PROFILES = {
    # What RoboPianist 1.0.10 compiles to.
    "reference": PhysicsProfile(
        timestep=0.005,
        integrator="Euler",
        solver="Newton",
        cone="pyramidal",
        iterations=100,
        impratio=10.0,
    ),
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
