"""Contact laws, one a file; `base` says what a law gives and which routes it can take."""
