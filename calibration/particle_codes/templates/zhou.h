#define SOFTJAX_D ((softjax_real){{ d }})      /* 3 delta_cr/(2A) [-] */
#define SOFTJAX_X ((softjax_real){{ x }})      /* chi E/Y [-] */
#define SOFTJAX_YIELD_VELOCITY {{ velocity }}  /* v_cr sqrt(M/R^3) [m/s (kg/m^3)^{1/2}] */
#define SOFTJAX_LIMIT_VELOCITY {{ limit_velocity }}     /* v_lim [m/s] */
#define SOFTJAX_SIGMA {{ sigma }}
#define SOFTJAX_PSI {{ psi }}
/* 1: acoustic and thermal losses, Eq. (17), are taken off the unloading force, so that the rebound is
 * eps v. 0: the contact force alone, whose rebound is eps_p v. */
#ifndef SOFTJAX_LOSSES
#define SOFTJAX_LOSSES {{ losses }}
#endif

{% if form == "full" %}
/* y^{3/2}; where cos(theta) is not real the rim carries nothing */
SOFTJAX_INLINE softjax_real softjax_rim(softjax_real y, softjax_real rise, softjax_real *slope) {
  const softjax_real root = y > 0 ? softjax_sqrt(y) : 0;
  *slope = 3 * root * rise / 2;
  return y * root;
}

/* Eq. (6) in units of delta_cr and k delta_cr^{3/2} */
SOFTJAX_INLINE softjax_real softjax_loading(softjax_real x, softjax_real *slope) {
  const softjax_real e = 2 * SOFTJAX_D / 3, square = (x - 1) * (x + 1);
  softjax_real rim;
  if (x <= 1) return softjax_rim(x, 1, slope);
  rim = softjax_rim(x - e * square, 1 - 2 * e * x, slope);
  *slope += 2 * SOFTJAX_D * x;
  return rim + SOFTJAX_D * square;
}

/* Eq. (11) */
SOFTJAX_INLINE softjax_real softjax_unloading(softjax_real x, softjax_real peak,
                                              softjax_real *slope) {
  const softjax_real e = 2 * SOFTJAX_D / 3, rise = 1 - e * peak;
  const softjax_real yielded = SOFTJAX_D * (peak - 1) * (peak + 1);
  softjax_real rim;
  if (peak <= 1) return softjax_loading(x, slope);
  rim = softjax_rim(rise * x + e, rise, slope);
  *slope += yielded * SOFTJAX_X / peak;
  return rim + yielded * (1 - SOFTJAX_X * (peak - x) / peak);
}

{% else %}
/* Eq. (8) in units of delta_cr and k delta_cr^{3/2} */
SOFTJAX_INLINE softjax_real softjax_loading(softjax_real x, softjax_real *slope) {
  const softjax_real root = softjax_sqrt(x), square = (x - 1) * (x + 1);
  *slope = 3 * root / 2;
  if (x <= 1) return x * root;
  *slope += SOFTJAX_D * (2 * x * (1 - root) - square / (2 * root));
  return x * root + SOFTJAX_D * square * (1 - root);
}

/* Eq. (12) */
SOFTJAX_INLINE softjax_real softjax_unloading(softjax_real x, softjax_real peak,
                                              softjax_real *slope) {
  const softjax_real root = softjax_sqrt(x), rest = 1 - SOFTJAX_D * peak;
  const softjax_real yielded = SOFTJAX_D * (peak - 1) * (peak + 1);
  if (peak <= 1) return softjax_loading(x, slope);
  *slope = 3 * rest * root / 2 + SOFTJAX_D / (2 * root) + yielded * SOFTJAX_X / peak;
  return rest * x * root + SOFTJAX_D * root + yielded * (1 - SOFTJAX_X * (peak - x) / peak);
}

{% endif %}
/* eps^2 of an impact by the work of its loading, of which the force gives `plastic` back: Eqs. (16) and (17), 1 at most */
SOFTJAX_INLINE double softjax_squared(const softjax_pair *pair, double peak, double work, double plastic) {
  const double radius = (double)pair->radius, limit = SOFTJAX_LIMIT_VELOCITY;
  const double yield = SOFTJAX_YIELD_VELOCITY * radius * sqrt(radius / (double)pair->mass);
  const double speed = peak > 1 ? yield : yield * sqrt(2.5 * work); /* whose losses are in no force */
  const double ratio = speed < limit ? speed / (limit - speed) : HUGE_VAL;
  if (!SOFTJAX_LOSSES) return plastic;
  return fmin(fmax(plastic + exp(-2 * SOFTJAX_SIGMA * pow(ratio, SOFTJAX_PSI)) - 1, 0), 1);
}
