#define SOFTJAX_MODULUS ((softjax_real){{ youngs_modulus }})   /* E [Pa] */
#define SOFTJAX_DISSIPATION ((softjax_real){{ dissipation_time }})  /* A [s] */

/* k (delta^{3/2} + 3/2 A sqrt(delta) delta'), k = 4/3 E sqrt(R) */
SOFTJAX_INLINE softjax_real softjax_damped(const softjax_pair *pair, softjax_real overlap,
                                           softjax_real rate, softjax_real *slope) {
  const softjax_real contact_radius = softjax_sqrt(pair->radius * overlap);
  const softjax_real stiff = 4 * SOFTJAX_MODULUS * contact_radius / 3; /* k sqrt(delta) */
  const softjax_real viscous = 3 * SOFTJAX_DISSIPATION * rate / 2;
  *slope = stiff * (3 + viscous / overlap) / 2;
  return stiff * (overlap + viscous);
}
