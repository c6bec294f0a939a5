#define SOFTJAX_LOADING_STIFFNESS ((softjax_real){{ loading_stiffness }})      /* k1 [N/m] */
#define SOFTJAX_UNLOADING_STIFFNESS ((softjax_real){{ unloading_stiffness }})  /* k20 [N/m] */
#define SOFTJAX_GROWTH ((softjax_real){{ growth }})                  /* s [1/m], k2 = k20 + s P_max */

SOFTJAX_INLINE softjax_real softjax_loading(softjax_real overlap, softjax_real *slope) {
  *slope = SOFTJAX_LOADING_STIFFNESS;
  return SOFTJAX_LOADING_STIFFNESS * overlap;
}

SOFTJAX_INLINE softjax_real softjax_unloading(softjax_real overlap, softjax_real peak,
                                              softjax_real *slope) {
  const softjax_real largest = SOFTJAX_LOADING_STIFFNESS * peak;
  *slope = SOFTJAX_UNLOADING_STIFFNESS + SOFTJAX_GROWTH * largest;
  return largest - *slope * (peak - overlap);
}
