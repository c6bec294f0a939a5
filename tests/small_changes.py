"""Small changes to the code, each with the tests that should notice it: see `tests.mutants`.

By file: what stands there once, what is put in its place, and the tests' files without "test_".
"""

CHANGES: dict[str, list[tuple[str, str, str]]] = {
    "softjax/contact.py": [
        ("return 4 / 3 * self.youngs_modulus", "return 3 / 4 * self.youngs_modulus", "contact"),
        ("speed_squared = 16 / 15", "speed_squared = 8 / 15", "contact"),
        ("one.poisson_ratio**2", "one.poisson_ratio", "contact"),
        ("_sqrt(3 * strength / density)", "_sqrt(strength / density)", "contact"),
        ("one.density > two.density", "one.density < two.density", "contact"),
        ("(1 + mass_1 / mass_2)", "(1 + mass_2 / mass_1)", "contact"),
    ],
    "softjax/empirical.py": [
        ("exponent = sigma * jnp.exp", "exponent = 0.999 * sigma * jnp.exp", "laws_empirical"),
        ("stopped = (velocity >= limit_velocity)", "stopped = velocity < 0", "laws_empirical"),
    ],
    "softjax/laws/zhou.py": [
        ("jnp.expm1(-2 * exponent)", "jnp.expm1(-exponent)", "hard_cases fit_materials"),
        ("return self.d * peak > 1", "return self.d * peak > 2", "status"),
        ("return squared, velocity >= limit", "return squared, velocity > limit", "hard_cases"),
        ("(1 - root)  # Eq. (8)", "(1 + root)  # Eq. (8)", "collide"),
        ("36 * (math.pi / 2) ** (8 / 3)", "36 * (math.pi / 2) ** (2 / 3)", "paper"),
        ("* x + 2 / 3 * self.d  # x x_m", "* x - 2 / 3 * self.d  # x x_m", "energy_balance"),
    ],
    "softjax/laws/_first_order.py": [
        (
            "yielded * part * (1 - 0.5 * X * part)",
            "yielded * part * (1 - X * part)",
            "energy_balance",
        ),
        (
            "r, q = jnp.where(has_root, r, 0.0)",
            "r, q = jnp.where(has_root, r, 0.1)",
            "energy_balance hard_cases",
        ),
        ("MOST_STEPS = 12", "MOST_STEPS = 1", "turning_point"),
    ],
    "softjax/laws/_full.py": [
        ("(2 / 3) ** 1.5 * jnp.sqrt(d)", "(2 / 3) ** 1.5 * d", "energy_balance hard_cases"),
        ("d * m**2 * (1 + m / 3)", "d * m**2 * (1 + m / 2)", "energy_balance"),
    ],
    "softjax/laws/thornton.py": [
        ("jnp.sqrt(1.2 - 0.2 * slow", "jnp.sqrt(1.2 - 0.1 * slow", "thornton"),
        ("jnp.where(x > 1, 1 + 1.5 * (x - 1)", "jnp.where(x > 1, 1 + 1.4 * (x - 1)", "thornton"),
    ],
    "softjax/laws/walton_braun.py": [
        ("return self.ratio + self.growth * peak", "return self.ratio", "laws_walton_braun"),
        (
            "self._stiffening(peak) >= 1",
            "self._stiffening(peak) > 1",
            "nearly_plastic status laws_walton_braun",
        ),
    ],
    "softjax/laws/viscoelastic.py": [
        ("return 1.5 * self.dissipation", "return self.dissipation", "laws_viscoelastic"),
    ],
    "softjax/laws/linear_dashpot.py": [
        ("jnp.sqrt(math.pi**2 + loss**2)", "jnp.sqrt(math.pi + loss**2)", "laws_linear_dashpot"),
    ],
    "softjax/restitution.py": [
        ("answered & (squared < 0)", "answered & (squared < -1)", "status"),
        ("answered & found.gains", "answered & ~found.gains", "status"),
        ("Status.ZERO_VELOCITY: impact.velocity == 0", "Status.ZERO_VELOCITY: ~answered", "status"),
        ("if self.each and any(", "if False and any(", "whole_fields"),
    ],
    "softjax/outcome.py": [
        (
            "peak.solved & ((back.solved & jnp.isfinite(back.value)) | ~peak.turns)",
            "peak.solved",
            "solver_failed",
        ),
        ('"float64": 1e-10', '"float64": 1e-2', "random_laws"),
        ("1 + gain + back.error", "1 + back.error", "nearly_plastic"),
    ],
    "calibration/fitting/neighbours.py": [
        ("square * values", "values", "neighbours"),
        ("few.points.restitution\n    few", "0\n    few", "neighbours"),
        ("CLOSE = 1e-3", "CLOSE = 1e9", "neighbours"),
    ],
    "softjax/_search.py": [
        ("slope = jax.jvp(force, (x,), (jnp.ones_like(x),))", "slope = force(x), x", "search"),
        ("jnp.where(evenly, 1 - share, 1.0)", "1.0", "search"),
        ("jnp.diff(x) * ", "", "search"),
        ("settled=turns & close & ~ends", "settled=turns", "search"),
    ],
    "softjax/impact.py": [
        ("elastic = velocity <= limit", "elastic = velocity < limit", "status"),
        ("(velocity >= 0)\n    some", "(velocity >= -1)\n    some", "validation status"),
    ],
    "softjax/energy.py": [
        ("return 2 * half * y **", "return half * y **", "laws_elastic_and_hard"),
        ("jnp.where(near, middle,", "jnp.where(~near, middle,", "energy_balance"),
        ("return peak._replace(time=_rise(law, overlap))", "return peak", "generic_laws"),
    ],
    "softjax/release.py": [
        ("JUMP = 1e-3", "JUMP = 1e3", "own_laws"),
        ("3 * beside[0] - 3 * beside[1]", "3 * beside[0] - 2 * beside[1]", "own_laws"),
    ],
    "softjax/_bridge.py": [
        ("samples), reached >= 1", "samples), reached >= 0", "solver_failed"),
        ("atol=tolerance)", "atol=1e4 * tolerance)", "ode"),
        ("(save <= between.t1)", "(save <= between.t0)", "collide"),
        ("jnp.sum(slope * change", "jnp.max(slope * change", "gradients"),
    ],
    "softjax/encke.py": [
        (
            "(HALF_PERIOD[law.work_exponent] + lag[0])",
            "HALF_PERIOD[law.work_exponent]",
            "ode collide",
        ),
        ("change = -2 * m * eta", "change = -m * eta", "ode"),
    ],
    "softjax/phase.py": [
        ("return -radius * lost", "return -1.0001 * radius * lost", "laws_hertz_dashpot"),
        ("falls = change * (1 - u) - g", "falls = change * (1 - u) - 0.9 * g", "laws_viscoelastic"),
    ],
    "softjax/_checks.py": [
        ("else np.array(value, _float_of", "else np.asarray(value, _float_of", "ownership"),
        ('lambda a: a > 0, f"a positive', 'lambda a: a >= 0, f"a positive', "validation"),
    ],
    "softjax/_batches.py": [
        (
            "values = np.asarray(result)[:count]",
            "values = np.asarray(result)[-count:]",
            "broadcasting",
        ),
    ],
    "softjax/_pieces.py": [
        ("start = max(stop - program.size, 0)", "pass", "large"),
    ],
    "calibration/fitting/losses.py": [
        ("MAD = 1.4826", "MAD = 1.0", "fit_any_law"),
        ("return np.clip(residual, -scale, scale)", "return residual", "fit_any_law"),
    ],
    "calibration/fitting/uncertainty.py": [
        ("if k or problem.loss", "if problem.loss", "uncertainty"),
        ("at = 0.5 * (1 + confidence)", "at = confidence", "uncertainty fit_any_law"),
        ("covariance, seen = covariance + added, seen + added", "pass", "shared_errors"),
        ("RANK_TOLERANCE = 1e-9", "RANK_TOLERANCE = 1e-1", "uncertainty"),
    ],
    "calibration/fitting/likelihood.py": [
        ("return 2 * self.fitted - 2 * self.log", "return self.fitted - 2 * self.log", "compare"),
        ("noises += 1\n", "noises += 0\n", "doubt_thresholds"),
    ],
    "calibration/fitting/noise.py": [
        ("LEAST = 1e-4", "LEAST = 0.9", "shared_errors"),
        ("np.sqrt(counts / scatter)", "np.sqrt(1 / scatter)", "shared_errors"),
        ("slope = (up - down) / (2 * STEP", "slope = (up - down) / (STEP", "fit_problem"),
    ],
    "calibration/fitting/variances.py": [
        ("if not restricted or not jacobian", "if True or not jacobian", "shared_errors"),
    ],
    "calibration/fitting/transform.py": [
        ("kinds = np.broadcast_to(self.kind, theta.shape)", "kinds = 0 * theta", "fit_options"),
        ("return np.where(direction > 0", "return np.where(direction < 0", "fit_options"),
    ],
    "calibration/fitting/profiles.py": [
        ("np.maximum(2 * cost - self.lowest", "np.maximum(cost - self.lowest", "fit_any_law"),
        ("done = (np.abs(high - low) <= TOLERANCE)", "done = high < np.inf", "fit_any_law"),
    ],
    "calibration/fitting/intervals.py": [
        (
            'return Estimate(value, method="undetermined", free=True)',
            "pass",
            "doubt",
        ),
        (
            "slope * z_error, ends[0], ends[1]",
            "slope * z_error, ends[1], ends[0]",
            "uncertainty fit_materials",
        ),
    ],
    "calibration/fitting/doubt.py": [
        ("if not apart > APART * error", "if not apart > 2 * APART * error", "doubt_thresholds"),
        ("if reduced <= limit", "if reduced <= 1.5 * limit", "doubt_thresholds"),
        ("if n < 10 or min(plus", "if n < 50 or min(plus", "doubt_thresholds"),
        (
            'way = "grow" if told.statistic > 0',
            'way = "grow" if told.statistic < 0',
            "doubt_thresholds",
        ),
        (
            "outside = (velocity < (1 - OUTSIDE) * low)",
            "outside = (velocity < 0)",
            "doubt_thresholds",
        ),
    ],
    "calibration/fitting/pooling.py": [
        ("information = slopes.T @ slopes\n", "information = 2 * slopes.T @ slopes\n", "pooling"),
        ("stdtrit(len(pool.members) - 1", "stdtrit(len(pool.members)", "pooling"),
    ],
    "calibration/fitting/goodness.py": [
        ("np.sqrt(np.maximum(1 - leverage, 1e-12))", "np.ones(len(data))", "cli_fit"),
    ],
    "calibration/fitting/left_out.py": [
        ("sums = np.bincount(self.fold, values)", "sums = values", "doubt_thresholds"),
        ("np.var(sums, ddof=1)", "np.var(sums)", "doubt_thresholds"),
    ],
    "calibration/fitting/collisions.py": [
        (
            "return tuple(sj.signed_restitution(law, velocity, route, elastic=elastic))",
            "return tuple(sj.signed_restitution(law, velocity, route))",
            "fit_problem",
        ),
    ],
    "calibration/handover/steps.py": [
        ("start = -phases * velocity * step", "start = 0 * phases * velocity", "export_choice"),
    ],
    "calibration/handover/substitutes.py": [
        ("math.atan2(math.pi, loss)", "math.atan2(math.pi, 2 * loss)", "export_choice"),
    ],
    "calibration/atomic.py": [
        ("if (directory / name).is_dir():", "if False:", "cli_files faults_writing"),
        ("shutil.rmtree(staged, ignore_errors=True)", "pass", "faults_writing cli_files"),
    ],
    "calibration/curve/velocities.py": [
        ("** (1 - part) * self.last**part", "* (self.last / self.first) ** part", "curve"),
    ],
    "calibration/curve/source.py": [
        ("not in (None, []):", "not in (None, [], 0):", "curve_command"),
    ],
    "calibration/curve/digits.py": [
        ("exponent = exponent - too_small + too_large", "pass", "curve"),
        ('text[:, 19] = np.where(exponent < 0, ord("-"), ord("+"))', "pass", "curve"),
    ],
    "calibration/studies/sobol.py": [
        ("width**2 * squares", "width * squares", "studies_sobol"),
        ("mixed[i] = b[i]", "mixed[i] = a[i]", "studies_sobol"),
        ("hit.coefficient, jnp.nan)", "hit.coefficient, 0.0)", "studies_sobol"),
    ],
    "calibration/studies/asked.py": [
        ("min(high, declared.upper)", "high", "studies_command"),
    ],
    "calibration/studies/planning.py": [
        ("kept = sets_beside(place, placed)", "kept = component.sets", "studies_information"),
        ("problem = reweighed(problem, z)", "pass", "studies_information"),
    ],
    "calibration/studies/shot_errors.py": [
        ("values, 1 / self.uncertainty", "values, self.uncertainty", "studies_shared"),
    ],
    "calibration/studies/planned.py": [
        ("else np.zeros(0) for k", "else uncertainty for k", "studies_shared"),
        ("self.spreads.get(p.name, p.spread)", "p.spread", "studies_information"),
    ],
    "softjax/laws/forces.py": [
        ("leaf if moved else jax.lax", "leaf if moved or True else jax.lax", "compilation"),
        (
            '[*forces, *asked(law, "breakpoints")',
            '[forces[0], *asked(law, "breakpoints")',
            "own_laws",
        ),
    ],
    "calibration/fitting/methods.py": [
        ("np.clip(gain, 0.0, 1.0)", "1.0", "fit_problem"),
    ],
    "calibration/studies/text.py": [
        ("{v * (v / fall):.6g}", "{v * (v * fall):.6g}", "studies_command"),
    ],
    "calibration/studies/local.py": [
        ("velocity * (1 + s[-1])", "velocity * (1 + 2 * s[-1])", "studies_local"),
        ('"m/s": (0, 1, -1)', '"m/s": (0, 1, 1)', "studies_local"),
    ],
    "calibration/studies/comparison.py": [
        ("TIE = 2.0", "TIE = 3.0", "compare"),
    ],
    "calibration/report/comparison.py": [
        ("_score(result.bic)", "_score(result.aic)", "compare_command"),
    ],
    "calibration/fitting/posterior/diagnostics.py": [
        ("ENERGY = 0.3", "ENERGY = 0.0", "posterior_told posterior"),
        ("share > MASS", "share > 1", "posterior_told posterior"),
        ("R_HAT = 1.01", "R_HAT = 2.0", "posterior_told posterior"),
    ],
    "calibration/fitting/posterior/priors.py": [
        ("- len(self.members) * z[self.spread]", "", "pooling"),
    ],
}
