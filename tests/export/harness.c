/* What the tests ask of a generated header, for ctypes. */
#include SOFTJAX_HEADER

typedef softjax_real real;

int size_of_real(void) { return (int)sizeof(real); }

/* force and stiffness of each overlap, all of one contact in this order */
void forces(int n, double radius, double mass, const double *overlap, const double *rate,
            double *force, double *stiffness) {
  softjax_pair pair = softjax_spheres((real)radius, (real)mass, (real)HUGE_VAL, (real)HUGE_VAL);
  softjax_contact memory = softjax_touch();
  int i;
  for (i = 0; i < n; i++) {
    real slope;
    force[i] = softjax_force(&pair, &memory, (real)overlap[i], (real)rate[i], &slope);
    stiffness[i] = slope;
  }
}

/* one impact by velocity Verlet as particle codes have it, the force at the velocity half a step before; it
 * begins a fraction `phase` of a step before touch. Where it does not end its coefficient is 0. */
typedef struct {
  double coefficient, duration, peak, force; /* [-], [s] while there is a force, [m], [N] */
} impact;

static impact collide(const softjax_pair *pair, double velocity, double step, double phase,
                      double gravity) {
  softjax_contact memory = softjax_touch();
  real v = (real)velocity, x = (real)(-phase * velocity * step), dt = (real)step, slope;
  impact found = {0, 0, 0, 0};
  long i;
  for (i = 0; i < 3000000; i++) {
    real force;
    x += v * dt;
    if (x <= 0 && v < 0) {
      found.coefficient = -(double)v / velocity;
      break;
    }
    force = softjax_force(pair, &memory, x, v, &slope);
    v += ((real)gravity - force / pair->mass) * dt;
    if (force > 0) found.duration += step;
    if (x > found.peak) found.peak = x;
    if (force > found.force) found.force = force;
  }
  return found;
}

void restitution(int n, double radius, double mass, const double *velocity, const double *step,
                 double phase, double gravity, double *numbers) {
  softjax_pair pair = softjax_spheres((real)radius, (real)mass, (real)HUGE_VAL, (real)HUGE_VAL);
  int i;
  for (i = 0; i < n; i++) {
    const impact found = collide(&pair, velocity[i], step[i], phase, gravity);
    numbers[i] = found.coefficient;
    numbers[n + i] = found.duration;
    numbers[2 * n + i] = found.peak;
    numbers[3 * n + i] = found.force;
  }
}

/* energy that the bodies have more than they brought, over a way of straight lines between turns,
 * by the midpoint rule; also the most energy that was in the contact */
double gained(int turns, const double *turn, int samples, double radius, double mass,
              double *most) {
  softjax_pair pair = softjax_spheres((real)radius, (real)mass, (real)HUGE_VAL, (real)HUGE_VAL);
  softjax_contact memory = softjax_touch();
  double gain = 0;
  int i, j;
  *most = 0;
  for (i = 1; i < turns; i++)
    for (j = 0; j < samples; j++) {
      const double width = (turn[i] - turn[i - 1]) / samples;
      real slope;
      gain -= width * softjax_force(&pair, &memory, (real)(turn[i - 1] + (j + 0.5) * width), 0, &slope);
      if (-gain > *most) *most = -gain;
    }
  return gain;
}
