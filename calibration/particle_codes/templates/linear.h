#define SOFTJAX_STIFFNESS ((softjax_real){{ stiffness }}) /* K [N/m] */
#define SOFTJAX_DAMPING ((softjax_real){{ damping }})     /* xi, fraction of critical damping [-] */

/* K delta + 2 xi sqrt(K M) delta' */
SOFTJAX_INLINE softjax_real softjax_damped(const softjax_pair *pair, softjax_real overlap,
                                           softjax_real rate, softjax_real *slope) {
  *slope = SOFTJAX_STIFFNESS;
  return SOFTJAX_STIFFNESS * overlap +
         2 * SOFTJAX_DAMPING * softjax_sqrt(SOFTJAX_STIFFNESS * pair->mass) * rate;
}
