{% set choice, (low, high) = export.choice, export.target.range %}
{% set hold, tabulated = choice.hold, name == "table.h" %}
{% set of_yield, has_losses = name in ("zhou.h", "thornton.h"), name in ("zhou.h", "table.h") %}
/* {{ export.notes[0] }}
{% for note in export.notes[1:] %}
{{ (" * " ~ note).rstrip() }}
{% endfor %}
 *
 * C99 and C++; needs nothing but the mathematical library. Units are SI, the overlap and its rate
 * (positive on approach) those of the two bodies, the force a repulsion along their line of centres.
 *
 *     softjax_pair pair = softjax_spheres(r1, m1, r2, m2);     once for each pair of sizes [m, kg];
 *                                                              HUGE_VAL for both of a flat, heavy wall
 *     softjax_contact memory = softjax_touch();                once for each contact
 *     force = softjax_force(&pair, &memory, overlap, rate, &stiffness);             [N], [N/m]
 *
 * Call it once a step while the overlap is positive; it forgets the contact where it is not.
 * -DSOFTJAX_REAL=float computes in single precision, -DSOFTJAX_INLINE=... qualifies the functions.
 */
#ifndef SOFTJAX_LAW_H
#define SOFTJAX_LAW_H 0x@hash@
#define SOFTJAX_LAW "softjax_@hash@" /* the name of this law and its numbers */

#include <math.h>

#ifndef SOFTJAX_REAL
#define SOFTJAX_REAL double
#endif
#ifndef SOFTJAX_INLINE
#define SOFTJAX_INLINE static inline
#endif

typedef SOFTJAX_REAL softjax_real;

/* overlaps are this many times those of the law, forces as many times less: eps is the same */
#define SOFTJAX_STRETCH ((softjax_real){{ choice.softening_factor }})

/* impact velocities [m/s] for which this was written, and the time step [s] tested with them */
#define SOFTJAX_SLOWEST {{ 0.0 if hold else low }}
#define SOFTJAX_FASTEST {{ high }}
#define SOFTJAX_STEP {{ export.time_step }}
{% if not end %}
/* an impact slower than this [m/s] unloads along the loading curve, with a dashpot of this fraction of critical
 * damping that makes its eps the one of that velocity; 0: no such impact. A faster one feels it where it loads again. */
#define SOFTJAX_HOLD_BELOW {{ held_below if hold else 0.0 }}
#define SOFTJAX_HOLD ((softjax_real){{ hold }})
{% endif %}

/* of two bodies: what depends on their sizes alone */
typedef struct {
  softjax_real radius; /* R1 R2/(R1 + R2) [m] */
  softjax_real mass;   /* M1 M2/(M1 + M2) [kg] */
} softjax_pair;

/* memory of one contact: largest overlap [m], and the factor of its unloading force (-1: not known yet, -2: held) */
typedef struct {
  softjax_real peak, factor;
} softjax_contact;

SOFTJAX_INLINE softjax_pair softjax_spheres(softjax_real radius_1, softjax_real mass_1,
                                            softjax_real radius_2, softjax_real mass_2) {
  const softjax_pair pair = {radius_1 / (1 + radius_1 / radius_2), mass_1 / (1 + mass_1 / mass_2)};
  return pair;
}

SOFTJAX_INLINE softjax_contact softjax_touch(void) {
  const softjax_contact contact = {0, (softjax_real)-1};
  return contact;
}

SOFTJAX_INLINE softjax_real softjax_sqrt(softjax_real x) {
  return sizeof(softjax_real) == sizeof(float) ? (softjax_real)sqrtf((float)x)
                                               : (softjax_real)sqrt((double)x);
}

{% if of_yield %}
/* of this pair of materials, whatever the sizes */
#define SOFTJAX_YIELD_OVERLAP {{ overlap }}    /* of first yield, over R [-] */
#define SOFTJAX_YIELD_FORCE {{ force }}        /* of first yield, over R^2 [Pa] */
{% endif %}
{% include name %}

/* whether the law is known for these sizes */
SOFTJAX_INLINE int softjax_fits(const softjax_pair *pair) {
  return {{ "fabs(pair->radius / SOFTJAX_RADIUS - 1) < 1e-6 && fabs(pair->mass / SOFTJAX_MASS - 1) < 1e-6"
            if tabulated else "pair->radius > 0 && pair->mass > 0" }};
}
{% if not end %}

/* integral from `low` to `high` of the force on loading, or on unloading where there is a peak: Gauss and Legendre's ten
 * points in the square root of the overlap, in which forces are smooth; once a contact */
SOFTJAX_INLINE double softjax_work(double low, double high, double peak) {
  static const double node[5] = {0.1488743389816312, 0.4333953941292472, 0.6794095682990244,
                                 0.8650633666889845, 0.9739065285171717};
  static const double weight[5] = {0.2955242247147529, 0.2692667193099964, 0.2190863625159820,
                                   0.1494513491505806, 0.0666713443086881};
  const int panels = {{ panels }};
  const double start = sqrt(low), width = (sqrt(high) - start) / panels;
  double sum = 0;
  int i;
  for (i = 0; i < 10 * panels; i++) {
    const double at = (1 + (i % 2 ? node[i % 10 / 2] : -node[i % 10 / 2])) / 2;
    const double root = start + width * (i / 10 + at);
    const softjax_real x = (softjax_real)(root * root);
    softjax_real slope;
    const softjax_real force = peak > 0 ? softjax_unloading(x, (softjax_real)peak, &slope)
                                        : softjax_loading(x, &slope);
    if (force > 0) sum += weight[i % 10 / 2] * root * (double)force;
  }
  return sum * width;
}

/* in two parts, as the body yields at 1 */
SOFTJAX_INLINE double softjax_loading_work(double x) {
  return softjax_work(0, x < 1 ? x : 1, 0) + (x > 1 ? softjax_work(1, x, 0) : 0);
}
{% if has_losses %}

/* where the unloading force vanishes, next to 0 where it does not */
SOFTJAX_INLINE double softjax_residual(double peak) {
  double low = 0, high = peak;
  softjax_real slope;
  int i;
  for (i = 0; i < 60; i++) {
    const double middle = (low + high) / 2;
    if (softjax_unloading((softjax_real)middle, (softjax_real)peak, &slope) > 0)
      high = middle;
    else
      low = middle;
  }
  return high;
}

/* by which the unloading force is multiplied, so that an impact gives eps^2 of its energy back */
SOFTJAX_INLINE softjax_real softjax_factor(const softjax_pair *pair, double peak) {
  const double up = softjax_loading_work(peak);
  const double down = softjax_work(softjax_residual(peak), peak, peak);
  return (softjax_real)(down > 0 ? softjax_squared(pair, peak, up, down / up) * up / down : 0);
}
{% endif %}
{% endif %}

/* contact force [N] at `overlap` [m] and its `rate` [m/s], and its slope with the overlap [N/m];
{% if not end %}
 * {{ "the rate acts where eps is held" if hold else "the rate does not act" }};
{% endif %}
 * {{ "it pulls before the overlap vanishes, as the law has it" if end == "zero-overlap" else
      "it never pulls: the bodies part where it vanishes, with what overlap remains" }} */
SOFTJAX_INLINE softjax_real softjax_force(const softjax_pair *pair, softjax_contact *contact,
                                          softjax_real overlap, softjax_real rate,
                                          softjax_real *stiffness) {
  const softjax_real length = SOFTJAX_STRETCH * (softjax_real)({{ "SOFTJAX_YIELD_OVERLAP * pair->radius" if of_yield
                                                                 else "SOFTJAX_TOP" if tabulated else 1 }});
  const softjax_real unit = (softjax_real)({{ "SOFTJAX_YIELD_FORCE * pair->radius * pair->radius" if of_yield
                                              else 1 }}) / SOFTJAX_STRETCH;
  softjax_real p, slope = 0;
  *stiffness = 0;
  if (!(overlap > 0)) {
    *contact = softjax_touch();
    return 0;
  }
{% if end %}
  p = softjax_damped(pair, overlap / length, rate, &slope);
{% else %}
  if (overlap >= contact->peak) {
    contact->peak = overlap;
    contact->factor = -1;
    p = softjax_loading(overlap / length, &slope);
  } else {
    const softjax_real peak = contact->peak / length;
    const double energy = 0.5 * (double)pair->mass * SOFTJAX_HOLD_BELOW * SOFTJAX_HOLD_BELOW;
    int held = contact->factor < -1;
    if (!held && contact->factor < 0) { /* the first time below this peak */
      held = (double)unit * (double)length * softjax_loading_work((double)peak) < energy;
      contact->factor = held ? -2 : {{ "softjax_factor(pair, (double)peak)" if has_losses else 1 }};
    }
    p = held ? softjax_loading(overlap / length, &slope)
             : contact->factor * softjax_unloading(overlap / length, peak, &slope);
    if (!held) slope *= contact->factor;
    if (SOFTJAX_HOLD > 0 && (held || rate > 0) && p > 0 && slope > 0)
      p += SOFTJAX_HOLD * rate / unit *
           softjax_sqrt(2 * pair->mass * unit * (p / overlap + slope / length));
  }
{% endif %}
{% if end != "zero-overlap" %}
  if (!(p > 0)) return 0;
{% endif %}
  *stiffness = slope * unit / length;
  return p * unit;
}
#elif SOFTJAX_LAW_H != 0x@hash@
#error "two laws of the prefix softjax: export one of them with another --prefix"
#endif
