"""What each particle code takes, and how.

    LAMMPS     `pair_style granular`, whose damping is over mass (1/s, 1/(s m)); `limit_damping` gives a
               larger ε than requested. For other laws a plugin around the C headers of a folder.
               Releases since 27 June 2024, the first with `coeff_restitution`.
    LIGGGHTS   `hooke/stiffness`, `hertz` and `hooke/hysteresis`, where k2 grows from k1. `limitForce on`
               gives a larger ε than requested; a modulus above 1 GPa needs `hard_particles yes`. No
               Thornton (1997): `thornton_ning` unloads with the old radius, 0.701 for 0.735, 0.259 for 0.282.
    YADE       ViscElMat, whose kn and cn of two bodies act in series; MindlinPhys with `betan`; LudingMat,
               where k2 grows from k1. All contacts end where the force vanishes: `en` of MindlinPhys
               means that, `en` of ViscElMat does not.

Measured with LAMMPS of 22 July 2025, LIGGGHTS 3.8.0 and YADE 2023.02a; see tests.
"""

from dataclasses import dataclass

INPUT, HEADER = "input", "header"  # how a code takes a law: by what it has, or by generated source
HOW = {INPUT: "by the code's own models, as input lines", HEADER: "by C source for the code"}
PLUGINS = ("lammps",)  # codes that load a library around the header
EXACT = "exact"  # the law itself
CONSTANT = "linear", "hertz-dashpot"  # the same ε at all velocities


@dataclass(frozen=True)
class Backend:
    """How a code takes a law.

    Attributes:
        name: `INPUT` or `HEADER`.
        fewest: time steps in the shortest contact, unless stated.
        from_loading: whether k2 of Walton and Braun's spring can only grow from k1.
        of_mass: whether the damping that is written holds for one effective mass alone.
        lines_of_pairs: whether each pair of types of atoms has a line of its own.
        scheme_error: the error of ε by N steps in a contact is this over N² at least.
        at_walls: whether it acts at walls too.
    """

    name: str
    fewest: int = 10
    from_loading: bool = False
    of_mass: bool = False
    lines_of_pairs: bool = False
    scheme_error: float = 0.0
    at_walls: bool = True


DAMPED = 20  # steps in a contact at least: a step makes dashpots weaker, never stronger
DASHPOT, OF_MASS = Backend(INPUT, DAMPED), Backend(INPUT, DAMPED, of_mass=True)
BACKENDS: dict[str, dict[str, Backend]] = {  # by code and law, in the order of what a law costs
    "c": {
        "linear": Backend(HEADER, DAMPED),
        "hertz-dashpot": Backend(HEADER, DAMPED),
        "viscoelastic": Backend(HEADER, DAMPED),
        "walton-braun": Backend(HEADER),
        EXACT: Backend(HEADER),
    },
    "lammps": {
        "linear": DASHPOT,
        "hertz-dashpot": DASHPOT,
        "viscoelastic": Backend(INPUT, DAMPED, of_mass=True, lines_of_pairs=True),
        "walton-braun": Backend(HEADER),
        EXACT: Backend(HEADER),
    },
    "liggghts": {
        "linear": OF_MASS,
        "hertz-dashpot": DASHPOT,
        "walton-braun": Backend(INPUT, from_loading=True),
    },
    "yade": {
        "linear": OF_MASS,
        "hertz-dashpot": DASHPOT,
        # LudingMat steps by another scheme: 0.030 off at 10 steps, 0.0019 at 40; and ε is 1.00 at a wall
        "walton-braun": Backend(INPUT, 40, from_loading=True, scheme_error=3.2, at_walls=False),
    },
}
