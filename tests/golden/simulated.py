"""Simulated measurements by plain NumPy, rounded as a laboratory's are: nothing of the library makes them."""

import numpy as np

from tests.fit_oracle import curve

# E [Pa], Poisson's ratio, density [kg/m³], Y [Pa]
ALLOY = (71e9, 0.33, 2700.0, 280e6)
HARDER = (71e9, 0.33, 2700.0, 420e6)
BRONZE = (115e9, 0.33, 7600.0, 300e6)
PLATE = (210e9, 0.3, 7850.0, 355e6)
RADIUS = 0.0125  # [m], of both spheres
POINTS = 24
GRAVITY = 9.80665


def equal_spheres(material, radius=RADIUS):
    """What `fit_oracle` takes of two equal spheres, by hand; the contact's area after Zhou."""
    E, nu, density, strength = material
    mass = 4 / 3 * np.pi * radius**3 * density
    pair = {"E": E / (2 * (1 - nu**2)), "R": radius / 2, "M": mass / 2, "Y": strength}
    return pair | {"v_lim": np.sqrt(3 * strength / density), "area": np.pi ** (2 / 3)}


def on_plate(material, plate, radius):
    """The same of a ball on a flat wall, the ball being the softer body."""
    E, nu, _, _ = material
    modulus = 1 / ((1 - nu**2) / E + (1 - plate[1] ** 2) / plate[0])
    ball = equal_spheres(material, radius)
    return ball | {"E": modulus, "R": radius, "M": 2 * ball["M"]}


def first_yield(pair):
    E, R, M, Y, _, area = pair.values()
    k = 4 / 3 * E * np.sqrt(R)
    overlap = (2 * np.pi * area * R * Y / (3 * k)) ** 2
    return np.sqrt(4 * k / (5 * M)) * overlap**1.25


def around_yield(material=ALLOY, below=8):
    """POINTS velocities on both sides of first yield [m/s]."""
    critical = first_yield(equal_spheres(material))
    low = np.linspace(0.15, 0.95, below) if below else np.zeros(0)
    return np.round(critical * np.append(low, np.geomspace(1.3, 80, POINTS - below)), 5)


def noisy(exact, size, seed):
    return np.round(exact + size * np.random.default_rng(seed).standard_normal(len(exact)), 5)


def rebounds(material=ALLOY, chi=1.2, sigma=0.9, psi=0.5, noise=0.003, seed=1, below=8):
    velocity = around_yield(material, below)
    return velocity, noisy(curve(velocity, equal_spheres(material), chi, sigma, psi), noise, seed)


def drops(seed=3, truth=(1.5, 1.2, 0.5), scatter=0.006):
    """A 12 mm bronze ball on a steel plate: nine heights three times, one drop lost [cm, mm]."""
    rng = np.random.default_rng(seed)
    height = np.repeat([0.05, 0.10, 0.20, 0.35, 0.50, 0.75, 1.00, 1.50, 2.00], 3)
    fallen = height + 0.002 * rng.standard_normal(len(height))
    pair = on_plate(BRONZE, PLATE, 0.006)
    exact = curve(np.sqrt(2 * GRAVITY * fallen), pair, *truth)
    back = (exact + scatter * rng.standard_normal(len(height))) ** 2 * fallen
    read = back + 0.002 * rng.standard_normal(len(height))
    rows = [f"{100 * h:g},{1000 * r:.0f}" for h, r in zip(height, read, strict=True)]
    del rows[19]
    return "drop height [cm],rebound height [mm]\n" + "\n".join(rows) + "\n"


def bounces(launches=4, jumps=6, scatter=0.002, seed=8):
    """Times [s] of bounces of a ball on a plate in several launches, and their labels."""
    rng = np.random.default_rng(seed)
    times, labels = [], []
    for k in range(launches):
        offset = 0.004 * rng.standard_normal()
        flight, at = 0.62 + 0.05 * k, 0.0
        for _ in range(jumps):
            times.append(at)
            labels.append(f"launch {k + 1}")
            at += flight
            v = 0.5 * GRAVITY * flight
            flight *= 0.93 * v**-0.05 + offset + scatter * rng.standard_normal()
    return np.round(times, 5), labels
