/* of this pair of materials, whatever the sizes */
#define SOFTJAX_D ((softjax_real){{ d }})      /* 3 delta_cr/(2A) [-] */
#define SOFTJAX_X ((softjax_real){{ x }})      /* chi E/Y [-] */
#define SOFTJAX_YIELD_OVERLAP {{ overlap }}    /* delta_cr/R [-] */
#define SOFTJAX_YIELD_FORCE {{ force }}        /* k delta_cr^{3/2}/R^2 [Pa] */
#define SOFTJAX_YIELD_VELOCITY {{ velocity }}  /* v_cr sqrt(M/R^3) [m/s (kg/m^3)^{1/2}] */
#define SOFTJAX_LIMIT_VELOCITY {{ limit_velocity }}     /* v_lim [m/s] */
#define SOFTJAX_SIGMA {{ sigma }}
#define SOFTJAX_PSI {{ psi }}
/* 1: acoustic and thermal losses, Eq. (17), are taken off the unloading force, so that the rebound is
 * eps v. 0: the contact force alone, whose rebound is eps_p v. */
#ifndef SOFTJAX_LOSSES
#define SOFTJAX_LOSSES {{ losses }}
#endif

SOFTJAX_INLINE softjax_real softjax_length(const softjax_pair *pair) {
  return (softjax_real)SOFTJAX_YIELD_OVERLAP * pair->radius;
}

SOFTJAX_INLINE softjax_real softjax_unit(const softjax_pair *pair) {
  return (softjax_real)SOFTJAX_YIELD_FORCE * pair->radius * pair->radius;
}

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
/* works in units of k delta_cr^{5/2}, in double: computed once a contact */
{% if form == "full" %}
/* integral of (y0 + y1 x + y2 x^2)^{3/2} by Gauss and Legendre's ten points in sqrt(x) */
SOFTJAX_INLINE double softjax_rim_work(double low, double high, double y0, double y1, double y2) {
  static const double node[5] = {0.1488743389816312, 0.4333953941292472, 0.6794095682990244,
                                 0.8650633666889845, 0.9739065285171717};
  static const double weight[5] = {0.2955242247147529, 0.2692667193099964, 0.2190863625159820,
                                   0.1494513491505806, 0.0666713443086881};
  const double middle = (sqrt(high) + sqrt(low)) / 2, half = (sqrt(high) - sqrt(low)) / 2;
  double sum = 0;
  int i, side;
  for (i = 0; i < 5; i++)
    for (side = -1; side <= 1; side += 2) {
      const double root = middle + side * half * node[i], x = root * root;
      const double y = y0 + x * (y1 + x * y2);
      if (y > 0) sum += weight[i] * 2 * root * y * sqrt(y);
    }
  return sum * half;
}

SOFTJAX_INLINE double softjax_unloading_in_double(double x, double peak) {
  const double d = (double)SOFTJAX_D, y = (1 - 2 * d * peak / 3) * x + 2 * d / 3;
  const double yielded = d * (peak - 1) * (peak + 1);
  return (y > 0 ? y * sqrt(y) : 0) + yielded * (1 - (double)SOFTJAX_X * (peak - x) / peak);
}

SOFTJAX_INLINE double softjax_loading_work(double x) {
  const double d = (double)SOFTJAX_D, e = 2 * d / 3;
  if (x <= 1) return 2 * x * x * sqrt(x) / 5;
  return 0.4 + softjax_rim_work(1, x, e, 1, -e) + d * (x - 1) * (x - 1) * (x + 2) / 3;
}

SOFTJAX_INLINE double softjax_unloading_work(double peak, double residual) {
  const double d = (double)SOFTJAX_D, e = 2 * d / 3, back = peak - residual;
  return softjax_rim_work(residual, peak, e, 1 - e * peak, 0) +
         d * (peak - 1) * (peak + 1) * back * (1 - (double)SOFTJAX_X * back / (2 * peak));
}
{% else %}
SOFTJAX_INLINE double softjax_unloading_in_double(double x, double peak) {
  const double d = (double)SOFTJAX_D, root = sqrt(x), yielded = d * (peak - 1) * (peak + 1);
  return ((1 - d * peak) * x + d) * root + yielded * (1 - (double)SOFTJAX_X * (peak - x) / peak);
}

/* Eq. (9) */
SOFTJAX_INLINE double softjax_loading_work(double x) {
  const double d = (double)SOFTJAX_D, root = sqrt(x), elastic = 2 * x * x * root / 5;
  if (x <= 1) return elastic;
  return elastic + d * ((x * x * x - 1) / 3 - (x - 1) - 2 * (x * x * x * root - 1) / 7 +
                        2 * (x * root - 1) / 3);
}

/* Eq. (15) */
SOFTJAX_INLINE double softjax_unloading_work(double peak, double residual) {
  const double d = (double)SOFTJAX_D, X = (double)SOFTJAX_X, back = peak - residual;
  const double top = sqrt(peak), low = sqrt(residual);
  const double elastic = peak * peak * top - residual * residual * low;
  return 2 * (1 - d * peak) * elastic / 5 + 2 * d * (peak * top - residual * low) / 3 +
         d * (peak - 1) * (peak + 1) * back * (1 - X * back / (2 * peak));
}
{% endif %}

SOFTJAX_INLINE double softjax_eq17_squared(double velocity) {
  const double limit = SOFTJAX_LIMIT_VELOCITY;
  if (velocity >= limit) return 0;
  return exp(-2 * SOFTJAX_SIGMA * pow(velocity / (limit - velocity), SOFTJAX_PSI));
}

/* where the unloading force vanishes, 0 where it does not */
SOFTJAX_INLINE double softjax_residual(double peak) {
  double low = 0, high = peak;
  int i;
  if (softjax_unloading_in_double(0, peak) >= 0) return 0;
  for (i = 0; i < 60; i++) {
    const double middle = (low + high) / 2;
    if (softjax_unloading_in_double(middle, peak) > 0)
      high = middle;
    else
      low = middle;
  }
  return high;
}

/* (eps/eps_p)^2 of the impact that reached this peak, Eqs. (16) and (17), eps at most 1 */
SOFTJAX_INLINE softjax_real softjax_factor(const softjax_pair *pair, softjax_real largest) {
  const double peak = (double)largest, radius = (double)pair->radius, mass = (double)pair->mass;
  double loading, yield, plastic, squared;
  if (!SOFTJAX_LOSSES) return 1;
  loading = softjax_loading_work(peak);
  yield = SOFTJAX_YIELD_VELOCITY * radius * sqrt(radius / mass);
  if (peak <= 1) return (softjax_real)softjax_eq17_squared(yield * sqrt(2.5 * loading));
  plastic = softjax_unloading_work(peak, softjax_residual(peak)) / loading;
  squared = plastic + softjax_eq17_squared(yield) - 1; /* Eq. (16) */
  if (squared > 1) squared = 1;
  return squared > 0 ? (softjax_real)(squared / plastic) : 0;
}
