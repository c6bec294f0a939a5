"""Tests that take long to compile what others compile too, or a neighbour of theirs checks: `long`."""

SLOW = [
    "test_notebooks.py::test_runs_and_gives_what_is_stored[8_into_a_particle_code]",
    "test_notebooks.py::test_runs_and_gives_what_is_stored[2_restitution_curves]",
    "test_notebooks.py::test_runs_and_gives_what_is_stored[4_speed_against_error]",
    "test_notebooks.py::test_runs_and_gives_what_is_stored[6_sensitivity]",
    "test_notebooks.py::test_runs_and_gives_what_is_stored[3_what_the_paper_prints]",
    "test_notebooks.py::test_runs_and_gives_what_is_stored[7_your_own_law]",
    "test_uncertainty_coverage.py::test_errors_that_are_shared_or_unequal[Thornton, specimens blocks]",
    "test_uncertainty_coverage.py::test_a_robust_loss_keeps_outliers_from_moving_chi[20]",
    "test_uncertainty_coverage.py::test_errors_that_are_shared_or_unequal[Thornton, trains 0.7 ms]",
    "test_posterior_samplers.py::test_blackjax_samples_it",
]
