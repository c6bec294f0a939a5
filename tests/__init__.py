"""The tests of softjax and calibration; values from outside the code under test in `oracles`."""
