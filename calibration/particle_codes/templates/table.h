/* of this pair of bodies alone: how a user's law depends on their sizes is not known */
#define SOFTJAX_RADIUS {{ radius }} /* R1 R2/(R1 + R2) [m] */
#define SOFTJAX_MASS {{ mass }}     /* M1 M2/(M1 + M2) [kg] */
#define SOFTJAX_TOP {{ top }} /* largest overlap of the table [m] */
#define SOFTJAX_ROWS {{ rows }}
#define SOFTJAX_COLUMNS {{ columns }}

/* Catmull and Rom's cubic through n values at 0, 1, ..., n - 1, and its slope; beyond them the end's */
SOFTJAX_INLINE double softjax_cubic(const double *y, int n, double t, double *slope) {
  const double at = t < 0 ? 0 : t > n - 1 ? n - 1 : t;
  const int i = (int)at < n - 1 ? (int)at : n - 2;
  const double f = at - i, rise = y[i + 1] - y[i];
  const double left = (i > 0 ? y[i + 1] - y[i - 1] : 4 * y[1] - 3 * y[0] - y[2]) / 2;
  const double right = (i < n - 2 ? y[i + 2] - y[i] : 3 * y[n - 1] - 4 * y[n - 2] + y[n - 3]) / 2;
  const double b = 3 * rise - 2 * left - right, c = left + right - 2 * rise;
  *slope = left + f * (2 * b + 3 * f * c);
  return y[i] + f * (left + f * (b + f * c)) + (t - at) * *slope;
}

/* over sqrt(overlap/top), evenly: force on loading [N], residual overlap over the peak, eps^2 */
static const double softjax_loading_table[SOFTJAX_ROWS] = {
{{ loading }}};
static const double softjax_residual_table[SOFTJAX_ROWS] = {
{{ residual }}};
static const double softjax_squared_table[SOFTJAX_ROWS] = {
{{ squared }}};
/* unloading force over that at the peak; rows as above, columns over the square root of
 * (overlap - residual)/(peak - residual), evenly */
static const double softjax_unloading_table[SOFTJAX_ROWS * SOFTJAX_COLUMNS] = {
{{ unloading }}};

SOFTJAX_INLINE double softjax_loading_at(double x, double *slope) {
  const double root = sqrt(x);
  const double force =
      softjax_cubic(softjax_loading_table, SOFTJAX_ROWS, root * (SOFTJAX_ROWS - 1), slope);
  *slope *= (SOFTJAX_ROWS - 1) / (2 * root);
  return force;
}

SOFTJAX_INLINE double softjax_unloading_at(double x, double peak, double *slope) {
  const double row = sqrt(peak) * (SOFTJAX_ROWS - 1);
  double value[4], change[4], ignored, root, share, force;
  const double largest = softjax_loading_at(peak, &ignored);
  const double rest = peak * softjax_cubic(softjax_residual_table, SOFTJAX_ROWS, row, &ignored);
  int i = (int)row - 1, k;
  *slope = 0;
  if (!(x > rest)) return 0;
  i = i < 0 ? 0 : i > SOFTJAX_ROWS - 4 ? SOFTJAX_ROWS - 4 : i;
  root = sqrt((x - rest) / (peak - rest));
  for (k = 0; k < 4; k++)
    value[k] = softjax_cubic(softjax_unloading_table + (i + k) * SOFTJAX_COLUMNS, SOFTJAX_COLUMNS,
                             root * (SOFTJAX_COLUMNS - 1), &change[k]);
  force = softjax_cubic(value, 4, row - i, &ignored);
  share = softjax_cubic(change, 4, row - i, &ignored);
  *slope = largest * share * (SOFTJAX_COLUMNS - 1) / (2 * root * (peak - rest));
  return largest * force;
}

SOFTJAX_INLINE softjax_real softjax_loading(softjax_real x, softjax_real *slope) {
  double s;
  const double force = softjax_loading_at((double)x, &s);
  *slope = (softjax_real)s;
  return (softjax_real)force;
}

SOFTJAX_INLINE softjax_real softjax_unloading(softjax_real x, softjax_real peak,
                                              softjax_real *slope) {
  double s;
  const double force = softjax_unloading_at((double)x, (double)peak, &s);
  *slope = (softjax_real)s;
  return (softjax_real)force;
}

/* so that an impact on these very tables gives eps^2 of its energy back: no cycle gains any */
SOFTJAX_INLINE softjax_real softjax_factor(const softjax_pair *pair, softjax_real largest) {
  const double peak = (double)largest;
  const double up = softjax_loading_work(peak), down = softjax_work(0, peak, peak);
  double slope, squared;
  (void)pair;
  squared = softjax_cubic(softjax_squared_table, SOFTJAX_ROWS, sqrt(peak) * (SOFTJAX_ROWS - 1), &slope);
  squared = squared > 1 ? 1 : squared < 0 ? 0 : squared;
  return (softjax_real)(down > 0 ? squared * up / down : 0);
}
