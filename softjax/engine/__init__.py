"""How one impact is computed, by works and roots or by the equation of motion, and how many are."""
