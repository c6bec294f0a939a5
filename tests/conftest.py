"""One precision for all tests, and the array types in signatures checked while they run."""

from jaxtyping import install_import_hook

# The physics behind the public names, where every annotation is meant literally. The names that
# users call say what they accept themselves, with a ValueError (test_validation).
CHECKED = (
    "softjax._numerics",
    "softjax.empirical",
    "softjax.energy",
    "softjax.collision",
    "softjax.laws._first_order",
    "softjax.laws._full",
)

with install_import_hook(CHECKED, "beartype.beartype"):
    import softjax as sj
    import softjax.collision

sj.enable_x64()
