{% set hertz = "4 * SOFTJAX_MODULUS * softjax_sqrt(pair->radius * overlap) / 3" %}
{% set e, xi = ("MODULUS", youngs_modulus, "E [Pa]"), ("DAMPING", damping, "xi, fraction of critical damping [-]") %}
{% set formula, constants, spring, dashpot, slope = {
  "LinearSpringDashpot": (
    "K delta + 2 xi sqrt(K M) delta'", [("STIFFNESS", stiffness, "K [N/m]"), xi], "SOFTJAX_STIFFNESS",
    "2 * SOFTJAX_DAMPING * softjax_sqrt(spring * pair->mass)", "spring"),
  "HertzDashpot": (
    "k delta^{3/2} + xi sqrt(5 M k) delta^{1/4} delta', k = 4/3 E sqrt(R)", [e, xi], hertz,
    "SOFTJAX_DAMPING * softjax_sqrt(5 * pair->mass * spring)", "3 * spring / 2 + dashpot * rate / (4 * overlap)"),
  "ViscoelasticHertz": (
    "k (delta^{3/2} + 3/2 A sqrt(delta) delta'), k = 4/3 E sqrt(R)", [e, ("DISSIPATION", dissipation_time, "A [s]")],
    hertz, "3 * SOFTJAX_DISSIPATION * spring / 2", "3 * spring / 2 + dashpot * rate / (2 * overlap)")}[kind] %}
{% for name, value, meaning in constants %}
#define SOFTJAX_{{ name }} ((softjax_real){{ value }}) /* {{ meaning }} */
{% endfor %}

/* {{ formula }} */
SOFTJAX_INLINE softjax_real softjax_damped(const softjax_pair *pair, softjax_real overlap,
                                           softjax_real rate, softjax_real *slope) {
  const softjax_real spring = {{ spring }};
  const softjax_real dashpot = {{ dashpot }};
  *slope = {{ slope }};
  return spring * overlap + dashpot * rate;
}
