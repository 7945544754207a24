"""Where a known asset stands: pose hypotheses, registration, and what is left over."""
