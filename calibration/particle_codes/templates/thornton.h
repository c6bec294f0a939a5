/* Hertz's force, from first yield on a straight line */
SOFTJAX_INLINE softjax_real softjax_loading(softjax_real x, softjax_real *slope) {
  const softjax_real root = x > 1 ? 1 : softjax_sqrt(x);
  *slope = 3 * root / 2;
  return x > 1 ? 1 + 3 * (x - 1) / 2 : x * root;
}

/* Hertz's force about what remains, with the contact radius of the peak */
SOFTJAX_INLINE softjax_real softjax_unloading(softjax_real x, softjax_real peak,
                                              softjax_real *slope) {
  softjax_real largest, back, part, root;
  if (peak <= 1) return softjax_loading(x, slope);
  largest = softjax_loading(peak, slope);
  back = largest / softjax_sqrt(peak);
  part = 1 - (peak - x) / back;
  root = part > 0 ? softjax_sqrt(part) : 0;
  *slope = 3 * largest * root / (2 * back);
  return largest * part * root;
}
