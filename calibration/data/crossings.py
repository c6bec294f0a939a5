"""Impacts where fitted flights of a track cross, the contact between them, and the errors of both.

A ball that arrives with v and leaves t_c later with ε v crosses its own path t_c ε/(1 + ε) after it arrived, and
v t_c ε/(1 + ε) below the floor: v is the velocity of the flight that much before the crossing, ε v that of the next
one the rest of t_c after it. With t_c = c v^-p, the crossings' heights

    z_j = z_floor - c v_j^{1-p} ε_j/(1 + ε_j)

give z_floor and c by generalised least squares, where what is known of c beforehand is one more observation.
Everything is linear in the errors of the parameters of the flights, of their common pull and of c:

    δT = (δz₂ - δz₁)/(v₁ - v₂),    δz = δz₁ + v₁ δT,    δv₁ = ∂v₁ + v₁' δT,    δc = Σ w_j δz_j

so that the covariance of all ε and v of a track is J C J' (GUM, 5.1.2), with the part that the crossings have in
common by a flight, the pull or c. Of J √C the triangular factor L of V = L L' is kept: independent errors of size 1.

A ball that arrives with 4.4 m/s, ε = 0.8, t_c = 4 ms: the crossing is 1.78 ms after its arrival and 7.8 mm below the
floor, where the flights have 4.417 and 3.542 m/s, the ratio of which is 0.0018 too large.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from calibration.data.contact_time import OF_HERTZ, ContactTime
from calibration.data.flights import Column, Flight

ROUNDS = 2  # of ε in the times of a contact, each a factor of 100 or more closer
FEWEST_FOR_CONTACT = 3  # crossings from which c follows without knowledge of it


class Crossing(NamedTuple):
    """Meeting point of a flight, by its number, and the next one: time [s], height, their upward velocities there."""

    flight: int
    time: float
    height: float
    before: float
    after: float


class Contact(NamedTuple):
    """t_c = `factor` v^-`power`: least squares of the crossings' heights.

    Attributes:
        error: standard uncertainty of `factor` that is not the flights'.
        weights: (m,), ∂factor/∂z_j.
        total: standard uncertainty of `factor`.
    """

    factor: float
    power: float
    error: float
    weights: Column
    total: float

    def at(self, velocity: Column) -> Column:
        """t_c [s] of arrivals at these velocities [m/s]."""
        return self.factor * velocity**-self.power


class Impacts(NamedTuple):
    """v, ε v and T of the crossings, in the unit of the track, and the sensitivities of ε and v.

    Attributes:
        of_restitution, of_velocity: (m, q), derivatives in independent errors of size 1.
    """

    velocity: Column
    restitution: Column
    of_restitution: Float[np.ndarray, "m q"]
    of_velocity: Float[np.ndarray, "m q"]


class Errors(NamedTuple):
    """Standard errors of the flights' frames, of their common pull (0: known), and metres in a unit.

    `scaled`: whether the pull gives the metre.
    """

    deviation: float
    pull: float
    metre: float
    scaled: bool


def crossing_of(number: int, first: Flight, second: Flight, near: float) -> Crossing | None:
    """The crossing of two flights next to a time [s]; None where they do not meet."""
    time = near
    for _ in range(20):
        (z1, v1), (z2, v2) = first.state(time), second.state(time)
        if v1 >= v2:
            return None
        step = float((z1 - z2) / (v1 - v2))
        time -= step
        if abs(step) < 1e-12 * max(abs(time), 1e-3):
            break
    (z1, v1), (_, v2) = first.state(time), second.state(time)
    return Crossing(number, time, float(z1), float(v1), float(v2))


class Moves(NamedTuple):
    """Changes of a crossing in independent errors of size 1, two a flight and one of the pull: (q,) each."""

    height: Column
    before: Column
    after: Column


def moves_of(crossing: Crossing, flights: Sequence[Flight], errors: Errors) -> Moves:
    """δz, δv₁ and δv₂ of a crossing."""
    fixed = np.zeros(
        (2, 2, 2 * len(flights) + 1)
    )  # height and velocity of both flights, at a fixed time
    for along, k in zip(fixed, (crossing.flight, crossing.flight + 1), strict=True):
        by = flights[k].slopes(crossing.time)
        root = errors.deviation * np.linalg.cholesky(flights[k].covariance)
        along[:, 2 * k : 2 * k + 2] = by[:, :2] @ root
        along[:, -1] = by[:, 2] * errors.pull
    first, second = fixed
    time = (second[0] - first[0]) / (crossing.before - crossing.after)
    falls = (
        flights[crossing.flight].fall(crossing.before),
        flights[crossing.flight + 1].fall(crossing.after),
    )
    height = first[0] + crossing.before * time
    return Moves(height, first[1] + falls[0] * time, second[1] + falls[1] * time)


def contact_of(
    crossings: Sequence[Crossing],
    moves: Sequence[Moves],
    metre: float,
    known: ContactTime | None,
    power: float = OF_HERTZ / 2,
) -> Contact:
    """c of t_c = c v^-p by the heights of the crossings, and what is known of it."""
    m = len(crossings)
    prior = None if known is None else (known.factor, known.factor * known.uncertainty)
    power = power if known is None else known.power
    if prior is not None and (prior[1] == 0 or m < FEWEST_FOR_CONTACT - 1):
        return Contact(prior[0], power, prior[1], np.zeros(m), prior[1])
    if m < FEWEST_FOR_CONTACT and prior is None:
        return Contact(0.0, power, 0.0, np.zeros(m), 0.0)
    height, before, after = np.array([c[2:] for c in crossings]).T
    along = np.array([move.height for move in moves])
    covariance = along @ along.T
    arrival, share = -before, after / (after - before)  # ε/(1 + ε)
    depth = arrival * (arrival * metre) ** -power * share
    design = np.stack([np.ones(m), -depth], axis=1)
    for _ in range(2):
        weights = np.linalg.inv(covariance)
        normal, target = design.T @ weights @ design, design.T @ weights @ height
        if prior is not None:
            normal[1, 1] += prior[1] ** -2
            target[1] += prior[0] * prior[1] ** -2
        inverse = np.linalg.inv(normal)
        estimate = inverse @ target
        off = height - design @ estimate
        # a floor that is not even: the crossings scatter more than their flights
        excess = float(off @ weights @ off) / max(m - 2 + (prior is not None), 1)
        if excess <= 1:
            break
        covariance = covariance * excess
    by_height = (inverse @ design.T @ weights)[1]
    total = float(np.sqrt(inverse[1, 1]))
    of_flights = float(np.sum((by_height @ along) ** 2))
    error = float(np.sqrt(max(total**2 - of_flights, 0.0)))
    return Contact(float(estimate[1]), power, error, by_height, total)


def impacts_of(
    crossings: Sequence[Crossing],
    moves: Sequence[Moves],
    flights: Sequence[Flight],
    errors: Errors,
    contact: Contact,
) -> Impacts:
    """v [m/s] and ε of the crossings with the contact between flights; errors of flights, pull, contact."""
    m, q = len(crossings), 2 * len(flights) + 2
    velocity, restitution = np.zeros(m), np.zeros(m)
    of_restitution, of_velocity, of_factor = np.zeros((m, q)), np.zeros((m, q)), np.zeros(q)
    of_factor[:-1] = contact.weights @ np.array([move.height for move in moves])
    of_factor[-1] = contact.error
    for j, (crossing, move) in enumerate(zip(crossings, moves, strict=True)):
        first, second = flights[crossing.flight], flights[crossing.flight + 1]
        ratio = -crossing.after / crossing.before
        of_one = (-crossing.before * errors.metre) ** -contact.power  # t_c/c
        for _ in range(ROUNDS):
            earlier, later = of_one * ratio / (1 + ratio), of_one / (1 + ratio)
            arrival = -float(first.state(crossing.time - contact.factor * earlier)[1])
            departure = float(second.state(crossing.time + contact.factor * later)[1])
            # that of the mean velocities over both parts, which are of one depth
            ratio = (crossing.after + departure) / (arrival - crossing.before)
        of_arrival, of_departure = np.append(-move.before, 0.0), np.append(move.after, 0.0)
        of_arrival += first.fall(crossing.before) * earlier * of_factor
        of_departure += second.fall(crossing.after) * later * of_factor
        velocity[j], restitution[j] = errors.metre * arrival, departure / arrival
        of_restitution[j] = (of_departure - restitution[j] * of_arrival) / arrival
        of_velocity[j] = errors.metre * of_arrival
        if errors.scaled:  # v = v_unit g'/a
            of_velocity[j, -2] -= velocity[j] * errors.pull / first.pull
    return Impacts(velocity, restitution, of_restitution, of_velocity)


def with_contact(
    crossings: Sequence[Crossing],
    flights: Sequence[Flight],
    errors: Errors,
    known: ContactTime | None,
) -> tuple[Impacts, Contact]:
    """Impacts, and the contact's duration, where its decrease with v may be unknown.

    Of a solid ball p is 1/5, of a thin shell 0: without bodies the impacts are the means of both, and half the
    difference is a further error that all impacts share.
    """
    moves = [moves_of(crossing, flights, errors) for crossing in crossings]
    contact = contact_of(crossings, moves, errors.metre, known)
    if known is not None or not np.any(contact.weights):
        return impacts_of(crossings, moves, flights, errors, contact), contact
    ends = [contact_of(crossings, moves, errors.metre, known, power) for power in (0.0, OF_HERTZ)]
    shell, solid = (impacts_of(crossings, moves, flights, errors, end) for end in ends)
    half = [0.5 * (of_solid - of_shell) for of_shell, of_solid in zip(shell, solid, strict=True)]
    impacts = Impacts(
        shell.velocity + half[0],
        shell.restitution + half[1],
        np.column_stack([shell.of_restitution + half[2], half[1]]),
        np.column_stack([shell.of_velocity + half[3], half[0]]),
    )
    return impacts, contact


def root_of(impacts: Impacts) -> Float[np.ndarray, "k k"]:
    """L with L L' the covariance of (ε, v), (2m, 2m), by the QR decomposition of J √C."""
    along = np.concatenate([impacts.of_restitution, impacts.of_velocity])
    lower = np.asarray(np.linalg.qr(along.T, mode="r")).T
    square = np.zeros((len(along), len(along)))
    square[:, : lower.shape[1]] = lower
    return square
