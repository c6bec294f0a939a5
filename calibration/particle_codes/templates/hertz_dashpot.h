#define SOFTJAX_MODULUS ((softjax_real){{ youngs_modulus }}) /* E [Pa] */
#define SOFTJAX_DAMPING ((softjax_real){{ damping }}) /* xi = alpha/sqrt(5) [-] */

/* k delta^{3/2} + alpha sqrt(M k) delta^{1/4} delta', k = 4/3 E sqrt(R) */
SOFTJAX_INLINE softjax_real softjax_damped(const softjax_pair *pair, softjax_real overlap,
                                           softjax_real rate, softjax_real *slope) {
  const softjax_real contact_radius = softjax_sqrt(pair->radius * overlap);
  const softjax_real stiff = 4 * SOFTJAX_MODULUS * contact_radius / 3; /* k sqrt(delta) */
  const softjax_real damping = SOFTJAX_DAMPING * softjax_sqrt(5 * pair->mass * stiff);
  *slope = 3 * stiff / 2 + damping * rate / (4 * overlap);
  return stiff * overlap + damping * rate;
}
