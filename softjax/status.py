"""What happened at each impact velocity, as flags that may coincide."""

import enum


class Status(enum.IntFlag):
    """The state of one collision: a set of flags, one integer per impact velocity.

    A failure is a value before it is an exception: hard cases come out as a number and a flag,
    never as NaN, so that one bad velocity in a batch leaves its neighbours alone.

    | flag | what happens | value |
    |---|---|---|
    | `PLAIN` | yields on loading, recovers part of the overlap | as computed |
    | `ELASTIC` | v <= v_cr: nothing yields | eps_p = 1, eps by Eq. (17) |
    | `NO_RESIDUAL_OVERLAP` | the unloading force stays positive down to zero overlap | residual 0 |
    | `ENERGY_GAIN` | eps_p > 1 (just above yield, or a small unloading factor) | as computed |
    | `NO_REBOUND` | eps_p^2 + eps_up^2 < 1: Eq. (16) has no real value | eps = 0, gradient 0 |
    | `BEYOND_EXPANSION` | d x_m > 1, or plastic radius beyond the contact radius | as computed |
    | `NO_TURNING_POINT` | the loading force vanishes before the bodies stop | eps = eps_p = 0 |
    | `ABOVE_LIMIT_VELOCITY` | v >= v_lim: Eq. (17) has no real value | 0 in its place |
    | `ZERO_VELOCITY` | v = 0: d(eps)/dv is infinite for psi < 1 | eps = 1, gradient 0 |
    | `INVALID_INPUT` | NaN, negative or infinite input under `jit` | eps = 0, gradient 0 |
    | `SOLVER_FAILED` | the integration used up its steps, or a formula gives no number | 0, gradient 0 |
    | `INEXACT` | works differ by 1e-10 of the energy (float32: 1e-5; by the ODE 1e-3), or a force jumps | as computed |
    | `NO_END` | the overlap creeps to zero and never gets there: overdamped | eps = eps_p = 0 |
    """

    PLAIN = 0
    ELASTIC = 1
    NO_RESIDUAL_OVERLAP = 2
    ENERGY_GAIN = 4
    NO_REBOUND = 8
    BEYOND_EXPANSION = 16
    NO_TURNING_POINT = 32
    ABOVE_LIMIT_VELOCITY = 64
    ZERO_VELOCITY = 128
    INVALID_INPUT = 256
    SOLVER_FAILED = 512
    INEXACT = 1024
    NO_END = 2048

    __str__ = enum.Flag.__str__

    @staticmethod
    def is_ok(status):
        """Whether nothing but `ELASTIC` is flagged: within the law's range, without a fault. Elementwise."""
        return (status & ~int(Status.ELASTIC)) == 0

    @staticmethod
    def has_peak(status):
        """Whether the bodies come to rest, and the solver got there: there is a largest overlap. Elementwise."""
        return (status & _NO_PEAK) == 0

    @staticmethod
    def has_end(status):
        """Whether the bodies part again too: the numbers are those of a whole collision. Elementwise."""
        return (status & (_NO_PEAK | int(Status.NO_END))) == 0

    @staticmethod
    def has_rebound(status):
        """Whether the law has a rebound to show there: other flags qualify the value. Elementwise."""
        return (status & _NO_REBOUND) == 0

    @staticmethod
    def has_fault(status):
        """Whether the input makes no sense or the numbers are not right; other flags are of the law's range.

        Elementwise.
        """
        return (status & _FAULTS) != 0

    @property
    def advice(self) -> str:
        """What a user can do about it, in one sentence (empty where nothing is wrong)."""
        return " ".join(text for flag, text in _ADVICE.items() if flag in self)


_FAULTS = int(Status.INVALID_INPUT | Status.SOLVER_FAILED | Status.INEXACT)
_NO_PEAK = int(Status.NO_TURNING_POINT | Status.INVALID_INPUT | Status.SOLVER_FAILED)
_NO_REBOUND = _NO_PEAK | int(Status.NO_REBOUND | Status.ABOVE_LIMIT_VELOCITY | Status.NO_END)
_ADVICE = {
    Status.NO_RESIDUAL_OVERLAP: "Check the unloading factor: X = chi E/Y is about 1 or below.",
    Status.ENERGY_GAIN: "The law returns more than it took; a larger unloading factor loses more.",
    Status.NO_REBOUND: "The losses exceed the impact energy: lower sigma or the unloading factor.",
    Status.BEYOND_EXPANSION: "The law is used beyond its range; lower velocities are in it.",
    Status.NO_TURNING_POINT: "The law has no collision at this velocity; lower velocities have.",
    Status.ABOVE_LIMIT_VELOCITY: "Eq. (17) ends at the limit velocity sqrt(3 Y/rho).",
    Status.SOLVER_FAILED: "Raise `max_steps`, loosen `rtol` or take a method of higher order.",
    Status.INEXACT: "Declare the law's `breakpoints`, and its `residual_overlap` where a force jumps.",
    Status.NO_END: "Lower the damping, or let the contact end at zero force.",
    Status.INVALID_INPUT: "Give finite positive properties and a finite velocity >= 0.",
}
