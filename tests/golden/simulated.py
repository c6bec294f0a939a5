"""Simulated measurements by plain NumPy, rounded as a laboratory's are: nothing of the library makes them."""

import numpy as np
from scipy.optimize import brentq

# E [Pa], Poisson's ratio, density [kg/m³], Y [Pa]
ALLOY = (71e9, 0.33, 2700.0, 280e6)
HARDER = (71e9, 0.33, 2700.0, 420e6)
BRONZE = (115e9, 0.33, 7600.0, 300e6)
PLATE = (210e9, 0.3, 7850.0, 355e6)
RADIUS = 0.0125  # [m], of both spheres
POINTS = 24
GRAVITY = 9.80665


def equal_spheres(material, radius=RADIUS):
    """(E*, R*, M*, Y, v_lim) of two equal spheres, by hand."""
    E, nu, density, strength = material
    mass = 4 / 3 * np.pi * radius**3 * density
    return E / (2 * (1 - nu**2)), radius / 2, mass / 2, strength, np.sqrt(3 * strength / density)


def on_plate(material, plate, radius):
    """The same of a ball on a flat wall, the ball being the softer body."""
    E, nu, density, strength = material
    modulus = 1 / ((1 - nu**2) / E + (1 - plate[1] ** 2) / plate[0])
    mass = 4 / 3 * np.pi * radius**3 * density
    return modulus, radius, mass, strength, np.sqrt(3 * strength / density)


def first_yield(pair):
    """v_cr and d = 3 δ_cr/(2A), the contact's area after Zhou."""
    E, R, M, Y, _ = pair
    A, k = np.pi ** (2 / 3) * R, 4 / 3 * E * np.sqrt(R)
    overlap = (2 * np.pi * A * Y / (3 * k)) ** 2
    return np.sqrt(4 * k / (5 * M)) * overlap**1.25, 1.5 * overlap / A


def eq_17(velocity, limit, sigma, psi):
    return np.exp(-sigma * (velocity / (limit - velocity)) ** psi)


def zhou(velocity, pair, chi, sigma, psi):
    """Eqs. (8), (12), (16), (17): works are polynomials in √x, roots by Brent's method."""
    critical, d = first_yield(pair)
    X = chi * pair[0] / pair[3]
    up = eq_17(critical, pair[4], sigma, psi)

    def loaded(x):
        return 0.4 * x**2.5 + d * (x**3 / 3 - x - x**3.5 / 3.5 + x**1.5 / 1.5)

    def above(y):
        high = 2 * max(y, 2.0) ** 0.8
        m = brentq(lambda x: loaded(x) - loaded(1.0) - 0.4 * (y**2 - 1), 1.0, high, xtol=1e-15)
        a, b, c = 1 - d * m, d, d * (m**2 - 1)

        def force(x):
            return a * x**1.5 + b * x**0.5 + c * (1 - X * (1 - x / m))

        def work(x):
            return 0.4 * a * x**2.5 + b * x**1.5 / 1.5 + c * (x - X * (x - x**2 / (2 * m)))

        end = brentq(force, 0.0, m, xtol=1e-15) if force(0.0) < 0 else 0.0
        return np.sqrt(max((work(m) - work(end)) / (0.4 * y**2) + up**2 - 1, 0.0))

    plastic = [above(v / critical) if v > critical else 0.0 for v in velocity]
    return np.where(velocity > critical, plastic, eq_17(velocity, pair[4], sigma, psi))


def thornton(velocity, elastic):
    """Thornton (1997), from the velocity of first yield on."""
    r = np.minimum(elastic / velocity, 1.0)
    slow = r / (r + 2 * np.sqrt(1.2 - 0.2 * r**2))
    return np.where(r < 1, np.sqrt(1.2 * np.sqrt(3)) * np.sqrt(1 - r**2 / 6) * slow**0.25, 1.0)


def around_yield(material=ALLOY, below=8):
    """POINTS velocities on both sides of first yield [m/s]."""
    critical, _ = first_yield(equal_spheres(material))
    low = np.linspace(0.15, 0.95, below) if below else np.zeros(0)
    return np.round(critical * np.append(low, np.geomspace(1.3, 80, POINTS - below)), 5)


def noisy(exact, size, seed):
    """With Gaussian noise, to five decimals."""
    return np.round(exact + size * np.random.default_rng(seed).standard_normal(len(exact)), 5)


def rebounds(material=ALLOY, chi=1.2, sigma=0.9, psi=0.5, noise=0.003, seed=1, below=8):
    """v [m/s] and ε of Zhou's law."""
    velocity = around_yield(material, below)
    return velocity, noisy(zhou(velocity, equal_spheres(material), chi, sigma, psi), noise, seed)


def drops(seed=3):
    """A 12 mm bronze ball on a steel plate: nine heights three times, one drop lost [cm, mm].

    Heights are set and read to 2 mm, and ε scatters by 0.006 besides.
    """
    rng = np.random.default_rng(seed)
    height = np.repeat([0.05, 0.10, 0.20, 0.35, 0.50, 0.75, 1.00, 1.50, 2.00], 3)
    fallen = height + 0.002 * rng.standard_normal(len(height))
    pair = on_plate(BRONZE, PLATE, 0.006)
    exact = zhou(np.sqrt(2 * GRAVITY * fallen), pair, 1.5, 1.2, 0.5)
    back = (exact + 0.006 * rng.standard_normal(len(height))) ** 2 * fallen
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
