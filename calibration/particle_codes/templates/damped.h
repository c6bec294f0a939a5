{% set linear = kind == "LinearSpringDashpot" %}
{% if linear %}
#define SOFTJAX_STIFFNESS ((softjax_real){{ stiffness }}) /* K [N/m] */
{% else %}
#define SOFTJAX_MODULUS ((softjax_real){{ youngs_modulus }}) /* E [Pa] */
{% endif %}
{% if kind == "ViscoelasticHertz" %}
#define SOFTJAX_DISSIPATION ((softjax_real){{ dissipation_time }})  /* A [s] */
{% else %}
#define SOFTJAX_DAMPING ((softjax_real){{ damping }}) /* xi, fraction of critical damping [-] */
{% endif %}

/* {{ {"LinearSpringDashpot": "K delta + 2 xi sqrt(K M) delta'",
       "HertzDashpot": "k delta^{3/2} + xi sqrt(5 M k) delta^{1/4} delta', k = 4/3 E sqrt(R)",
       "ViscoelasticHertz": "k (delta^{3/2} + 3/2 A sqrt(delta) delta'), k = 4/3 E sqrt(R)"}[kind] }} */
SOFTJAX_INLINE softjax_real softjax_damped(const softjax_pair *pair, softjax_real overlap,
                                           softjax_real rate, softjax_real *slope) {
{% if linear %}
  const softjax_real spring = SOFTJAX_STIFFNESS;
  const softjax_real dashpot = 2 * SOFTJAX_DAMPING * softjax_sqrt(spring * pair->mass);
  *slope = spring;
{% else %}
  const softjax_real spring = 4 * SOFTJAX_MODULUS * softjax_sqrt(pair->radius * overlap) / 3;
{% if kind == "HertzDashpot" %}
  const softjax_real dashpot = SOFTJAX_DAMPING * softjax_sqrt(5 * pair->mass * spring);
  *slope = 3 * spring / 2 + dashpot * rate / (4 * overlap);
{% else %}
  const softjax_real dashpot = 3 * SOFTJAX_DISSIPATION * spring / 2;
  *slope = 3 * spring / 2 + dashpot * rate / (2 * overlap);
{% endif %}
{% endif %}
  return spring * overlap + dashpot * rate;
}
