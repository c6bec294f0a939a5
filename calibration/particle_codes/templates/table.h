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

SOFTJAX_INLINE softjax_real softjax_loading(softjax_real x, softjax_real *slope) {
  const double root = sqrt((double)x);
  double rise;
  const double force =
      softjax_cubic(softjax_loading_table, SOFTJAX_ROWS, root * (SOFTJAX_ROWS - 1), &rise);
  *slope = (softjax_real)(rise * (SOFTJAX_ROWS - 1) / (2 * root));
  return (softjax_real)force;
}

SOFTJAX_INLINE softjax_real softjax_unloading(softjax_real x, softjax_real peak,
                                              softjax_real *slope) {
  const double row = sqrt((double)peak) * (SOFTJAX_ROWS - 1);
  double value[4], change[4], ignored, root, share, force;
  const double largest = (double)softjax_loading(peak, slope);
  const double rest =
      (double)peak * softjax_cubic(softjax_residual_table, SOFTJAX_ROWS, row, &ignored);
  int i = (int)row - 1, k;
  *slope = 0;
  if (!(x > rest)) return 0;
  i = i < 0 ? 0 : i > SOFTJAX_ROWS - 4 ? SOFTJAX_ROWS - 4 : i;
  root = sqrt(((double)x - rest) / ((double)peak - rest));
  for (k = 0; k < 4; k++)
    value[k] = softjax_cubic(softjax_unloading_table + (i + k) * SOFTJAX_COLUMNS, SOFTJAX_COLUMNS,
                             root * (SOFTJAX_COLUMNS - 1), &change[k]);
  force = softjax_cubic(value, 4, row - i, &ignored);
  share = softjax_cubic(change, 4, row - i, &ignored);
  *slope = (softjax_real)(largest * share * (SOFTJAX_COLUMNS - 1) / (2 * root * ((double)peak - rest)));
  return (softjax_real)(largest * force);
}

/* eps^2 of an impact, by these very tables: no cycle gains energy */
SOFTJAX_INLINE double softjax_squared(const softjax_pair *pair, double peak, double work, double plastic) {
  double slope;
  (void)pair, (void)work, (void)plastic;
  return fmin(fmax(softjax_cubic(softjax_squared_table, SOFTJAX_ROWS, sqrt(peak) * (SOFTJAX_ROWS - 1), &slope), 0), 1);
}
