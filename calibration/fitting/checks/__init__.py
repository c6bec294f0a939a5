"""Checks of a fit, each of which may raise a warning: a room for each subject, collected in `collected`."""
