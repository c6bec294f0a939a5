"""Tests that take long to compile what others compile too, or a neighbour of theirs checks: `long`."""

SLOW = [
    "test_uncertainty_coverage.py::test_errors_that_are_shared_or_unequal[Thornton, specimens blocks]",
    "test_uncertainty_coverage.py::test_a_robust_loss_keeps_outliers_from_moving_chi[20]",
    "test_uncertainty_coverage.py::test_errors_that_are_shared_or_unequal[Thornton, trains 0.7 ms]",
    "test_posterior_samplers.py::test_blackjax_samples_it",
]
