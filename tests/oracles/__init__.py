"""Values from outside the library under test: high-precision arithmetic and its tables."""
